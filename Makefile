PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test slow check golden bench clean
.DEFAULT_GOAL := test

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	$(BIN)/python -m compileall -q kb engine
	touch $@

SENTENCE := process probes 1 and 2 in the furnace for 15 min, cool them down in the freezer for 5 min \
and store them in the drawer again

demo: $(VENV)/ready
	$(BIN)/cellwright plan themse --command "$(SENTENCE)"
	$(BIN)/cellwright plan bulkhead/twelve_points --stats

test: $(VENV)/ready
	$(BIN)/python -m pytest

slow: $(VENV)/ready
	$(BIN)/python -m pytest -m slow

check: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest

golden: $(VENV)/ready
	$(BIN)/python -m pytest --update-golden --update-plans

bench: $(VENV)/ready
	$(BIN)/python benchmarks/plan.py

clean:
	rm -rf $(VENV) build dist *.egg-info
