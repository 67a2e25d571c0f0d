"""What causes do to a cell when they are noticed: each key of a fault base by itself, on a
small bench.
"""

from pathlib import Path

import pytest

from cellwright.engine.pipelines.recovery.world_model import (
    Dynamics,
    FaultyCell,
    WorldState,
    plan_history,
)
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Function, Variable

DOMAIN = """domain: bench
types: {item: object}
objects: {item: [a, b, c]}
fluents: {"found": {}, "marked(item)": {}, "held(item)": {}}
events: {"measured(item)": {}}
operators:
  find: {adds: found}
  measure(Item): {preconditions: found, adds: measured(Item), resources: Item}
  mark(Item): {preconditions: found, adds: marked(Item)}
  grip(Item): {preconditions: found, adds: held(Item)}
"""
PROBLEM = """problem: task
domain: domain.yaml
workflow:
  - {name: a, stages: measured(a)}
  - {name: b, stages: measured(b)}
  - {name: c, stages: "measured(c), marked(c)"}
"""
FAULTS = """faults: bench
exceptions:
  odd:
    say: the value is odd
    of: measure(Item)
    reply: odd
    causes: {moved: 1, worn: 1, silent: 1, lost: 1, dull: 1}
causes:
  moved: {say: the part has moved, spoils: "measured(_), marked(_)", since: [find]}
  worn: {say: the tool is worn, spoils: measured(_)}
  silent: {say: only the reply was lost, completes: true}
  lost: {say: the item is gone, loses: [Item]}
  dull: {say: the tool is dull}
tests:
  look: {say: look, cost: 1, outcomes: [good, bad], otherwise: good, gives: {moved: bad}}
repairs:
  wait: {say: wait, cost: 1, cures: {dull: 1}}
"""
DONE = ("find", "measure(a)", "mark(a)", "find", "measure(b)")


def step(text: str) -> Function:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


@pytest.fixture
def cell(tmp_path: Path) -> tuple[FaultyCell, WorldState]:
    """The cell when `measure(c)` got an odd reply, and the state before that step."""
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    (tmp_path / "faults.yaml").write_text(FAULTS)
    (tmp_path / "p.yaml").write_text(PROBLEM)
    loaded = load(tmp_path / "p.yaml")
    assert loaded.problem is not None
    model, _ = load_faults(tmp_path / "domain.yaml")
    dynamics = Dynamics(loaded.problem)
    plan = Plan(tuple(Step(StepId(n), step(text)) for n, text in enumerate(DONE, 1)))
    state, achieved = plan_history(dynamics, plan, [each.id for each in plan.steps])
    binding = {Variable("Item"): step("c")}
    return FaultyCell(dynamics, model, "odd", binding, step("measure(c)"), achieved), state


def told(state: WorldState) -> tuple[set[str], dict[str, int]]:
    return set(map(str, state.facts)), dict(state.reached)


def test_before_anything_is_noticed_the_work_is_done(cell: tuple[FaultyCell, WorldState]) -> None:
    assert told(cell[1]) == ({"found", "marked(a)"}, {"a": 1, "b": 1, "c": 0})


def test_what_was_done_since_the_cause_was_surely_not_there_is_open_again(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    """The part was found a second time between measuring a and b: only b is in doubt."""
    faulty, before = cell
    spoilt, stands = faulty.spoilt("moved")
    assert [str(each.step) for each in spoilt] == ["measure(b)"]
    assert [str(each.step) for each in stands] == ["measure(a)", "mark(a)"]
    assert told(faulty.begun(before, ("moved",))) == (
        {"found", "marked(a)"},
        {"a": 1, "b": 0, "c": 0},
    )


def test_without_such_a_step_all_that_the_cause_spoils_is_open_again(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    faulty, before = cell
    assert told(faulty.begun(before, ("worn",))) == (
        {"found", "marked(a)"},
        {"a": 0, "b": 0, "c": 0},
    )
    early = FaultyCell(
        faulty.dynamics, faulty.model, "odd", faulty.binding, faulty.interrupted, faulty.done[1:3]
    )
    assert told(early.begun(before, ("moved",))) == ({"found"}, {"a": 0, "b": 1, "c": 0})


def test_a_step_whose_reply_alone_was_wrong_has_done_what_it_should(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    faulty, before = cell
    assert told(faulty.begun(before, ("silent",)))[1] == {"a": 1, "b": 1, "c": 1}
    assert faulty.blocked("silent") == ()
    assert told(faulty.begun(before, ("dull",))) == told(before)
    assert faulty.failing(("dull",), step("measure(c)")) == "dull"


def test_a_step_that_could_not_be_taken_is_not_completed(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    faulty, before = cell
    unfound = WorldState(frozenset(), before.reached)
    assert faulty.begun(unfound, ("silent",)) == unfound


def test_steps_that_need_what_is_lost_fail_and_others_do_not(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    faulty, _ = cell
    assert faulty.failing(("lost",), step("measure(c)")) == "lost"
    assert faulty.failing(("lost",), step("measure(a)")) == ""


def test_work_that_a_cause_spoils_is_in_vain_while_it_is_there(
    cell: tuple[FaultyCell, WorldState],
) -> None:
    faulty, before = cell
    assert faulty.failing(("worn",), step("measure(a)")) == "worn"
    assert faulty.failing(("worn",), step("mark(c)")) == ""
    assert faulty.taken(before, ("worn",), step("measure(c)")) == before
    assert told(faulty.taken(before, (), step("measure(c)")))[1]["c"] == 1
