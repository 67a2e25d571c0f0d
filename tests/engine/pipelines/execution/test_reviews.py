"""Orders, lateness and limited stays while steps are under way: what has begun ends as it
began, the rest is planned anew.
"""

import shutil
from functools import cache
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import Finish, JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunExecution,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal
from tests.engine.pipelines.execution.executed_cells import Kept, executed, planned

FURTHER = GivenOrder(OperatorCommand.ADD, "process probe_2 in the furnace for 5 min")


def of(records: list[JournalRecord], kind: RecordKind) -> list[JournalRecord]:
    return [each for each in records if each.kind is kind]


@pytest.mark.parametrize(
    "at_ms", [3_000, *(pytest.param(each, marks=pytest.mark.slow) for each in (100_000, 930_000))]
)
def test_a_further_command_joins_while_steps_are_under_way_and_touches_none_of_them(
    at_ms: int,
) -> None:
    ending, records, cell = executed("themse/one", orders=TimedOrders([(at_ms, FURTHER)]))
    assert ending.outcome == "reached"
    assert "heated(probe_2, 300) of probe_2" in ending.goals
    assert cell.world.reached == {"1:probe_1": 3}
    sent, done = of(records, RecordKind.COMMAND), of(records, RecordKind.DONE)
    assert sorted(each.content["command"] for each in sent) == sorted(
        each.content["command"] for each in done
    )
    assert ending.steps == len(done)
    (joined,) = [each for each in of(records, RecordKind.PLAN) if each.content["why"] == "add"]
    under_way = {number for number, _ in joined.content["running"]}
    begun = {each.content["command"] for each in sent if each.number < joined.number}
    ended = {each.content["command"] for each in done if each.number < joined.number}
    assert under_way == begun - ended
    assert {each.content["action"] for each in sent if each.content["command"] in under_way} == {
        each["step"] for each in joined.content["steps"][: len(under_way)]
    }


def test_what_makes_no_sense_is_refused_and_the_run_goes_on() -> None:
    ending, records, _ = executed(
        "themse/one", orders=TimedOrders([(3_000, GivenOrder(OperatorCommand.ADD, "dance"))])
    )
    assert ending.outcome == "reached"
    assert [each.content["what"] for each in of(records, RecordKind.DECISION)][-1] == "add refused"


@pytest.mark.slow
def test_two_commands_at_the_same_time_are_both_followed() -> None:
    further = [
        (3_000, FURTHER),
        (3_000, GivenOrder(OperatorCommand.ADD, "process probe_3 in the furnace for 5 min")),
    ]
    ending, records, _ = executed("themse/one", orders=TimedOrders(further))
    assert ending.outcome == "reached"
    assert [each.content["why"] for each in of(records, RecordKind.PLAN)].count("add") == 2


def test_a_command_at_a_pause_waits_until_the_run_goes_on() -> None:
    orders = [
        (10_000, GivenOrder(OperatorCommand.INTERRUPT)),
        (100_000, FURTHER),
        (300_000, GivenOrder(OperatorCommand.CONTINUE)),
    ]
    ending, records, _ = executed("themse/one", orders=TimedOrders(orders))
    assert ending.outcome == "reached"
    assert not [each for each in of(records, RecordKind.COMMAND) if 100_000 <= each.at_ms < 300_000]


@pytest.mark.slow
def test_a_run_that_stops_behind_a_further_command_takes_it_up_again(tmp_path: Path) -> None:
    problem, _ = planned("themse/one")
    wanted = name_run(RunRequest("themse/one", store=str(tmp_path / "j.db")), problem)
    stop = GivenOrder(OperatorCommand.STOP)
    assert (
        begin_run(wanted, problem, TimedOrders([(100_000, FURTHER), (101_000, stop)])).outcome
        == "stopped"
    )
    ending = resume_run(wanted.store, wanted.run, TimedOrders())
    assert ending.outcome == "reached"
    assert len(ending.goals) == 4
    with Journal(wanted.store) as journal:
        done = [line.content["action"] for line in journal.lines(wanted.run, kinds=["done"])]
    assert done.count("pick(probe_1, slot(drawer, 1))") == 1


@cache
def short_stays(folder: Path, most: int) -> tuple[Problem, ReadyPlan]:
    """Two probes, and a furnace in which nothing may stay for longer than so many seconds."""
    home = folder / "lab"
    shutil.copytree(
        bundled_domains()["themse"], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    domain = home / "domain.yaml"
    text = domain.read_text("utf-8").replace(
        "\nstatics:", "\nstatics:\n  longest_stay(unit, time): {}", 1
    )
    domain.write_text(text, "utf-8")
    (home / "problems").mkdir()
    text = f"problem: two\ndomain: ..\nstatics:\n  - longest_stay(furnace, {most})\nworkflow:\n"
    text += (
        "  - for: {P: [probe_1, probe_2]}\n    stages: heated(P, 15 min), cooled(P, 5 min), "
        "stored(P)\n"
    )
    (home / "problems" / "two.yaml").write_text(text, "utf-8")
    problem = load_problem(str(home / "problems" / "two.yaml"))
    found = first_plan(problem)
    assert isinstance(found, ReadyPlan)
    return problem, found


def run(
    problem: Problem, ready: ReadyPlan, settings: SimulatorSettings
) -> tuple[Finish, list[JournalRecord]]:
    driver, kept = Simulator(HiddenCell(problem, None), settings), Kept()
    execution = RunExecution("r", problem, driver, Recorder(kept, driver.now_ms), TimedOrders())
    return execution.start(
        ready, SymbolicWorld.of(problem, initial_situation(problem).state)
    ), kept.records


def stays(records: list[JournalRecord]) -> list[int]:
    """How long each probe was in the furnace, from the end of the step that brought it to the
    start of the next.
    """
    brought, found = {}, []
    for each in of(records, RecordKind.DONE):
        name, _, rest = each.content["action"].partition("(")
        probe = rest.partition(",")[0]
        if name == "put" and "furnace" in rest:
            brought[probe] = each.at_ms
        elif name == "pick" and "furnace" in rest:
            found.append(each.content["started_ms"] - brought[probe])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_no_stay_is_too_long_without_being_told(tmp_path: Path, seed: int) -> None:
    problem, ready = short_stays(tmp_path, 960)
    ending, records = run(problem, ready, SimulatorSettings(seed, spread=0.2))
    assert ending.outcome == "reached"
    told = [
        each
        for each in of(records, RecordKind.EXCEPTION)
        if each.content["exception"] == "stays_too_long"
    ]
    assert all(stay <= 960_000 for stay in stays(records)) or told
    assert len(stays(records)) == 2
