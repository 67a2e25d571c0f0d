"""Facts that are looked at in the cell itself, when a step begins and while it lasts."""

import shutil
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    JournalRecord,
    RecordKind,
)
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.controllers.protocol import command_entry, read_command
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.plan_records import compiled_of, plan_content
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator
from cellwright.engine.pipelines.simulators.simulator_log import _command_entry, _read_command
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.execution.executed_cells import Kept

CLOSED = "position(flap, closed)"
LOOK = '    online:\n      - {fact: "position(flap, closed)", during: true}\n'
HEAT = "    command: {stream: $name(heat(Time)), reply: done}\n"


def cell_with(folder: Path, look: str) -> Path:
    """THEMSE, whose furnace looks at something when it heats."""
    home = folder / "lab"
    shutil.copytree(
        bundled_domains()["themse"], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    furnace = shutil.copytree(
        bundled_domains()["themse"].parent / "devices" / "furnace", home / "devices" / "furnace"
    )
    text = (furnace / "device.yaml").read_text("utf-8")
    (furnace / "device.yaml").write_text(text.replace(HEAT, HEAT + look), "utf-8")
    (home / "problems").mkdir()
    said = (
        "problem: heated\ndomain: ..\nworkflow:\n  - for: {P: [probe_1]}\n    stages: heated(P, "
        "15 min)\n"
    )
    (home / "problems" / "heated.yaml").write_text(said, "utf-8")
    return home / "problems" / "heated.yaml"


@cache
def planned(folder: Path) -> tuple[Problem, ReadyPlan]:
    problem = load_problem(str(cell_with(folder, LOOK)))
    ready = first_plan(problem)
    assert isinstance(ready, ReadyPlan)
    return problem, ready


@pytest.fixture(scope="module")
def heated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, ReadyPlan]:
    return planned(tmp_path_factory.mktemp("cells"))


class Draughty(HiddenCell):
    """A furnace whose flap does not stay where it is: from the so-manieth look on it is open."""

    last = 10**9

    def missing(self, looked_at: Sequence[str]) -> str:
        self.last -= bool(looked_at)
        return CLOSED if looked_at and self.last < 0 else super().missing(looked_at)


def run(problem: Problem, ready: ReadyPlan, looks: int) -> list[JournalRecord]:
    cell, kept = Draughty(problem, fault_base(problem)), Kept()
    cell.last = looks
    driver = Simulator(cell)
    execution = RunExecution(
        "r", problem, driver, Recorder(kept, driver.now_ms), TimedOrders(), fault_base(problem)
    )
    execution.start(ready, SymbolicWorld.of(problem, initial_situation(problem).state))
    return kept.records


def of(records: list[JournalRecord], kind: RecordKind) -> list[JournalRecord]:
    return [each for each in records if each.kind is kind]


def test_what_is_so_is_looked_at_and_nothing_else_changes(
    heated: tuple[Problem, ReadyPlan],
) -> None:
    records = run(*heated, looks=10**9)
    (heat,) = [each for each in of(records, RecordKind.COMMAND) if "heat" in each.content["action"]]
    assert heat.content["looks"] == heat.content["watches"] == [CLOSED]
    assert records[-1].content["outcome"] == "reached"
    others = [each for each in of(records, RecordKind.COMMAND) if each is not heat]
    assert not any("looks" in each.content for each in others)


def test_a_step_does_not_begin_if_what_it_looks_at_is_not_so(
    heated: tuple[Problem, ReadyPlan],
) -> None:
    records = run(*heated, looks=0)
    (heat,) = [each for each in of(records, RecordKind.COMMAND) if "heat" in each.content["action"]]
    (failed,) = of(records, RecordKind.EXCEPTION)
    assert (failed.content["reply"], failed.at_ms) == (f"not({CLOSED})", heat.at_ms)
    assert records[-1].content["outcome"] == "stopped"


def test_a_step_ends_at_once_if_what_it_watches_is_not_so_any_more(
    heated: tuple[Problem, ReadyPlan],
) -> None:
    problem, ready = heated
    driver = Simulator(HiddenCell(problem, None))
    for step in ready.plan.steps:
        if "heat" not in str(step.operator):
            driver.send([DriverCommand(int(step.id), CommandKind.STEP, "arm", str(step.operator))])
            driver.receive(None)
    heat = next(str(step.operator) for step in ready.plan.steps if "heat" in str(step.operator))
    begun = driver.now_ms()
    driver.send(
        [
            DriverCommand(
                100,
                CommandKind.STEP,
                "furnace",
                heat,
                "",
                "done",
                (),
                900_000,
                None,
                None,
                False,
                (CLOSED,),
                (CLOSED,),
            )
        ]
    )
    driver.send(
        [DriverCommand(101, CommandKind.STEP, "arm", "press_switch(closed, open)", lasts_ms=3_000)]
    )
    came = [*driver.receive(None), *driver.receive(None)]
    assert [(each.number, getattr(each, "text", ""), each.at_ms - begun) for each in came] == [
        (101, "done", 3_000),
        (100, f"not({CLOSED})", 3_000),
    ]
    assert set(driver.cell.world.reached.values()) == {0}


def test_looks_are_kept_in_journals_and_logs_and_on_the_wire(
    heated: tuple[Problem, ReadyPlan],
) -> None:
    problem, ready = heated
    entry = plan_content(ready, "first", RunScope(problem))
    assert compiled_of(entry).program == ready.compiled.program
    command = DriverCommand(
        1, CommandKind.STEP, "furnace", "heat", looks=(CLOSED,), watches=(CLOSED,)
    )
    assert read_command(command_entry(command)) == command
    assert _read_command(_command_entry(command)) == command


@pytest.mark.parametrize(
    "fact",
    ["position(flap, Setting)", "position(flap, closed), free(slot(furnace, 1))", "flying(Probe)"],
)
def test_a_look_is_at_one_known_fact_of_the_step(tmp_path: Path, fact: str) -> None:
    with pytest.raises(InvalidInput):
        load_problem(str(cell_with(tmp_path, f'    online:\n      - fact: "{fact}"\n')))
