"""What is added to a run while it goes on: goals in words, due dates and priorities.

Steps that have begun are not touched.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.run_goals import extend_problem, read_addition
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.stages.grounding import _Grounding, ground
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal
from tests.engine.pipelines.execution.executed_cells import executed, planned

FOUR = str(Path(__file__).parents[3] / "domains" / "bakery" / "problems" / "four.yaml")
URGENT = "due(t4, 15 min); priority(t4, 10)"


def added(text: str, at_ms: int) -> TimedOrders:
    return TimedOrders([(at_ms, GivenOrder(OperatorCommand.ADD, text))])


def baked(records: list[JournalRecord]) -> list[str]:
    """The trays in the order in which their baking begins."""
    sent = [each for each in records if each.kind is RecordKind.COMMAND]
    return [
        each.content["action"][5:7] for each in sent if each.content["action"].startswith("bake(")
    ]


@pytest.mark.slow
def test_a_due_date_that_is_given_while_it_runs_changes_the_order_of_what_has_not_begun() -> None:
    before = baked(executed(FOUR)[1])
    ending, records, _ = executed(FOUR, orders=added(URGENT, 7_000))
    assert ending.outcome == "reached"
    assert "t4" not in before[:2]
    assert baked(records)[0] == before[0]
    assert baked(records)[1] == "t4"
    done = [each.content["action"] for each in records if each.kind is RecordKind.DONE]
    assert len(done) == len(set(done)) == 20


@pytest.mark.slow
def test_a_further_command_comes_with_its_due_date() -> None:
    said = "process probe_2 in the furnace for 5 min; due(probe_2, 10 min)"
    ending, records, _ = executed("themse/one", orders=added(said, 3_000))
    assert ending.outcome == "reached"
    assert "heated(probe_2, 300) of probe_2" in ending.goals
    (plan,) = [
        each for each in records if each.kind is RecordKind.PLAN and each.content["why"] == "add"
    ]
    assert plan.content["wishes"] == ["due(probe_2, 603)"]


@pytest.mark.slow
def test_a_run_that_stops_behind_a_due_date_keeps_it(tmp_path: Path) -> None:
    problem, _ = planned(FOUR)
    wanted = name_run(RunRequest(FOUR, store=str(tmp_path / "j.db")), problem)
    orders = TimedOrders(
        [
            (7_000, GivenOrder(OperatorCommand.ADD, URGENT)),
            (8_000, GivenOrder(OperatorCommand.STOP)),
        ]
    )
    assert begin_run(wanted, problem, orders).outcome == "stopped"
    assert resume_run(wanted.store, wanted.run, TimedOrders()).outcome == "reached"
    with Journal(wanted.store) as journal:
        done = [line.content["action"] for line in journal.lines(wanted.run, kinds=["done"])]
    assert "t4" in [each[5:7] for each in done if each.startswith("bake(")][:2]


@pytest.mark.parametrize(
    "text", ["due(t9, 5 min)", "due(t4)", "due(t4, soon)", "priority(t4, high)", "due(t4, t3)"]
)
def test_what_is_wrong_with_a_wish_is_told(text: str) -> None:
    with pytest.raises(InvalidInput):
        read_addition(problem_of(FOUR), text)


def test_a_wish_takes_the_place_of_an_older_one_and_counts_from_now() -> None:
    problem = problem_of(FOUR)
    for at_ms, text in (
        (0, "due(t4, 15 min)"),
        (60_000, "due(t4, 5 min)"),
        (60_000, "due(t3, 1 h)"),
    ):
        more = read_addition(problem, text, at_ms)
        problem = extend_problem(problem, more.words, more.wishes)
    assert list(map(str, problem.statics)) == ["due(t4, 360)", "due(t3, 3660)"]


def many_points(folder: Path, count: int) -> str:
    """A bulkhead with many points, two of which are to be measured."""
    facts = [
        f"  - needs(m{n}, thickness)\n  - position(m{n}, {n * 7919 % 2000000}, {n}, 0)"
        for n in range(1, count + 1)
    ]
    text = (
        f"problem: many\ndomain: bulkhead\nobjects:\n  measurement: [m1..{count}]\nstatics:\n"
        + "\n".join(facts)
        + "\n"
        "initial:\n  - at(t3_746, approach_point(rack(us_probe)))\n"
        "goals:\n  - measured(_, _, meas(m5))\n  - measured(_, _, meas(m9))\n"
    )
    (folder / "many.yaml").write_text(text, "utf-8")
    return str(folder / "many.yaml")


def test_only_what_plans_name_of_many_points_is_grounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes = list[int]()

    def counted(self: _Grounding) -> GroundTask:
        made = whole(self)
        sizes.append(len(made.operators))
        return made

    whole = _Grounding.task
    monkeypatch.setattr(_Grounding, "task", counted)
    ending, records, _ = executed(many_points(tmp_path, 60), orders=added("measure m40", 3_000))
    assert ending.outcome == "reached"
    assert "us_measure(us_probe, t3_746, m40)" in [each.content.get("action") for each in records]
    named = max(sizes)
    ground(problem_of(many_points(tmp_path, 60)))
    assert named * 10 < sizes[-1]
