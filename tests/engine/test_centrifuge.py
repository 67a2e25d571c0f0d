"""A centrifuge cell: balance by a rule that sums over fluents, one step that spins all tubes inside, a bottle that runs dry."""

from dataclasses import replace
from pathlib import Path

from engine.model.outcome import Found, Infeasible
from engine.pipelines import planning
from engine.stages.macros.lifted.execution import changes_of
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain
from engine.stages.validation.semantics import Semantics
from kb.loader import load
from kb.model.problem import Problem
from kb.terms import Number

CELL = Path(__file__).parents[1] / "domains" / "centrifuge" / "problems"


def problem(name: str) -> Problem:
    found = load(CELL / f"{name}.yaml").problem
    assert found is not None
    return found


def test_four_tubes_are_filled_spun_and_put_back() -> None:
    outcome = planning.plan(problem("four"))
    assert isinstance(outcome, Found)
    steps = [step.operator for step in outcome.plan.steps]
    assert sum(each.name == "dispense" for each in steps) == 4
    assert 1 <= sum(each.name == "spin" for each in steps) <= 2


def test_every_spin_is_balanced() -> None:
    given = problem("four")
    outcome = planning.plan(given)
    assert isinstance(outcome, Found)
    semantics = Semantics(given)
    weight = {atom.arguments[0]: atom.arguments[1] for atom in given.statics if atom.name == "weight"}
    side = {f"position_{n}": 1 if n < 3 else -1 for n in range(1, 5)}
    state = semantics.initial()
    for step in outcome.plan.steps:
        bound = semantics.binding(step.operator)
        assert not isinstance(bound, str)
        if step.operator.name == "spin":
            sums = 0
            for atom in state:
                if atom.name == "at" and str(atom.arguments[1]) in side:
                    own = weight[atom.arguments[0]]
                    assert isinstance(own, Number)
                    sums += own.value * side[str(atom.arguments[1])]
            assert sums == 0
        change = semantics.change(*bound, semantics.facts(state), state)
        state = state - change.ends | change.adds
    left = next(atom.arguments[-1] for atom in state if atom.name == "volume")
    refilled = any(step.operator.name == "refill" for step in outcome.plan.steps)
    assert isinstance(left, Number)
    assert left.value == 2 or refilled


def test_a_run_sees_what_a_batch_did() -> None:
    given = problem("four")
    outcome = planning.plan(given)
    assert isinstance(outcome, Found)
    start = Situation.of(CellDomain(given), Semantics(given).initial())
    events = [event for change in changes_of(start, outcome.plan.steps) for event in change.events]
    assert sorted(str(each.arguments[0]) for each in events if each.name == "spun") == [
        f"tube_{number}" for number in range(1, 5)
    ]


def test_a_tube_that_nobody_wants_spun_is_not_spun() -> None:
    """An event that no stage names cannot occur, so one tube of four alone cannot be balanced."""
    given = problem("four")
    alone = replace(given, chains=given.chains[:1])
    assert isinstance(planning.plan(alone), Infeasible)
