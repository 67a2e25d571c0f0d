"""A centrifuge cell: balance by a rule that sums over fluents, one step that spins all tubes
inside, a bottle that runs dry.
"""

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan, plan_objective
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.plan_model import Claims
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import bundled_domains
from cellwright.kb.terms import Number

CELL = bundled_domains()["centrifuge"] / "problems"


def problem(name: str) -> Problem:
    found = load(CELL / f"{name}.yaml").problem
    assert found is not None
    return found


@pytest.mark.parametrize(("name", "tubes", "spins"), [("four", 4, 1), ("eight", 8, 2)])
def test_tubes_are_spun_in_as_few_batches_as_the_rotor_allows(
    name: str, tubes: int, spins: int
) -> None:
    outcome = checked_plan.plan_problem(problem(name))
    assert isinstance(outcome, Found)
    names = [step.operator.name for step in outcome.plan.steps]
    assert names.count("dispense") == names.count("load") == names.count("unload") == tubes
    assert names.count("spin") == names.count("close_lid") == spins


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_few_batches_are_no_luck(seed: int) -> None:
    outcome = checked_plan.plan_problem(problem("four"), SearchLimits(seed=seed))
    assert isinstance(outcome, Found)
    assert sum(step.operator.name == "spin" for step in outcome.plan.steps) == 1


def test_the_plan_that_is_scheduled_has_few_batches() -> None:
    found = plan_objective.plan_for_objective(problem("four"))
    assert found.timetable is not None
    assert 600 < found.timetable.schedule.makespan < 800


def test_every_spin_is_balanced() -> None:
    given = problem("four")
    outcome = checked_plan.plan_problem(given)
    assert isinstance(outcome, Found)
    semantics = Semantics(given)
    weight = {
        atom.arguments[0]: atom.arguments[1] for atom in given.statics if atom.name == "weight"
    }
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
    outcome = checked_plan.plan_problem(given)
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
    assert isinstance(checked_plan.plan_problem(alone), Infeasible)


def test_a_sentence_fills_spins_and_puts_back() -> None:
    said = "spin tubes 1 to 4 for 10 minutes after adding 5 ml buffer, then put them back capped"
    posed = checked_plan.problem_of("centrifuge/four", command=said)
    outcome = checked_plan.plan_problem(posed)
    assert isinstance(outcome, Found)
    assert (
        checked_plan.check_plan(posed, outcome.plan, "plan", Claims(cost=outcome.plan.cost)) == []
    )
    names = [step.operator.name for step in outcome.plan.steps]
    assert names.count("dispense") == names.count("unload") == 4
    assert names.count("spin") == 1
    assert max(n for n, name in enumerate(names) if name == "dispense") < max(
        n for n, name in enumerate(names) if name == "spin"
    )


def test_every_step_of_the_cell_can_fail_in_a_way_that_is_known() -> None:
    model, warnings = load_faults(bundled_domains()["centrifuge"] / "domain.yaml")
    assert not warnings
    operators = {each.name for each in problem("four").domain.operators}
    assert {each.operator.name for each in model.exceptions.values() if each.operator} == operators


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "cause"),
    [
        ("spin(600)", "seated_badly"),
        ("dispense(tube_2, buffer, 5)", "air_in_line"),
        ("close_lid", "foreign_body"),  # a step without arguments
    ],
)
def test_a_run_recovers_from_a_fault(step: str, cause: str, tmp_path: Path) -> None:
    words = [
        "run",
        "centrifuge/four",
        "--fault",
        f"{step}={cause}",
        "--store",
        str(tmp_path / "store.db"),
    ]
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output
    assert "all goals are reached" in said.output
