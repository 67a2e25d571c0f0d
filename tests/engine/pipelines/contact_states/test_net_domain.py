"""Domains generated from contact models: THEMSE reaches what the hand-written domain reaches."""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.pipelines import contact_states
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.files import File
from cellwright.kb.loader import bundled_domains, load

THEMSE = bundled_domains()["themse"]
PROBLEMS = sorted(THEMSE.glob("problems/*.yaml"))
QUICK = ("in_furnace", "lid_on_stand", "one", "unsolvable")


@pytest.fixture(scope="module")
def generated() -> File:
    return contact_states.generate_domain(THEMSE / "domain.yaml")


def outcomes(problem: Path, generated: File) -> tuple[Outcome, Outcome]:
    """The answers for the hand-written and for the generated domain. Both plans are checked."""
    by_hand, made = load(problem).problem, load(problem, lambda _: generated).problem
    assert by_hand is not None
    assert made is not None
    return checked_plan.plan_problem(by_hand), checked_plan.plan_problem(made)


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(p, id=p.stem, marks=() if p.stem in QUICK else pytest.mark.slow)
        for p in PROBLEMS
    ],
)
def test_the_generated_domain_reaches_the_same_goals(problem: Path, generated: File) -> None:
    by_hand, made = outcomes(problem, generated)
    assert type(made) is type(by_hand)
    assert isinstance(made, Found | Infeasible)


def test_only_processes_are_taken_over(generated: File) -> None:
    domain = load(PROBLEMS[0], lambda _: generated).domain
    names = {each.name for each in domain.operators}
    assert {"heat", "cool", "sense", "drawer_slide_to_open", "grip_themse_drawer"} <= names
    assert not {"pick", "put", "open_drawer", "press_switch", "turn_bayonet"} & names


def test_a_plan_never_puts_a_probe_under_the_lid(generated: File) -> None:
    problem = load(THEMSE / "problems" / "lid_on_stand.yaml", lambda _: generated).problem
    assert problem is not None
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    steps = [each.operator.name for each in outcome.plan.steps]
    insert = next(
        n for n, name in enumerate(steps) if name.startswith("insert_probe_themse_freezer")
    )
    assert not any(name.startswith("put_themse_lid_themse_freezer") for name in steps[:insert])
