"""The examples of the page on extensions are extensions: each is put in its place and does what
the page says.
"""

import re
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine import plugins
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.ports import ContactFilter, DriverSetup
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.portfolio import STRATEGIES
from tests.docs.pages import TOP, run

PAGE = (TOP / "docs" / "extending.md").read_text("utf-8")
EXAMPLES = dict(re.findall(r"^```python (\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def names_of(example: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(EXAMPLES[example], f"extending.md, {example}", "exec"), names)
    return names


def test_a_run_goes_through_the_driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    made: list[Any] = []

    def load(group: str, name: str) -> Any:
        assert (group, name) == (plugins.DRIVER_GROUP, "bench")

        def driver(setup: DriverSetup) -> Any:
            made.append(names_of("driver")["driver"](setup))
            return made[0]

        return driver

    monkeypatch.setattr(plugins, "_load_plugin", load)
    monkeypatch.setattr(plugins, "registered_names", lambda _: ["bench"])
    ran = run("cellwright run themse/one --driver bench --store runs.db")
    assert ran.exit_code == 0, ran.output
    assert "all goals are reached" in ran.output
    assert len(made[0].known) >= 10


def test_the_filter_takes_states_away(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from cellwright.engine.pipelines import contact_states
    from cellwright.kb.model.contact_model import ContactModel

    few = names_of("filter")["AtMostTwo"]

    def both(name: str, model: ContactModel) -> ContactFilter:
        found: ContactFilter = few(model) if name == "templates" else original(name, model)
        return found

    original = plugins.contact_filter
    monkeypatch.chdir(tmp_path)
    before = run("cellwright states themse --format json").stdout
    monkeypatch.setattr(contact_states, "contact_filter", both)
    after = run("cellwright states themse --format json").stdout
    assert "more than two contacts" in after
    assert "more than two contacts" not in before


def test_the_strategy_plans() -> None:
    names_of("strategy")
    try:
        found = checked_plan.plan_problem(
            checked_plan.problem_of("bulkhead/one_point"), SearchLimits(strategy="patient")
        )
    finally:
        del STRATEGIES["patient"]
    assert isinstance(found, Found)


def test_each_port_of_the_page_is_found_by_an_entry_point() -> None:
    groups = set(re.findall(r"`(cellwright\.\w+)`", PAGE))
    assert groups == {plugins.GEOMETRY_GROUP, plugins.CONTACT_FILTERS, plugins.DRIVER_GROUP}
