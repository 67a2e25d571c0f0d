"""What holds already costs nothing: in words, in stages and in goals."""

from dataclasses import replace
from itertools import pairwise

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Function


def planned(problem: Problem, limits: SearchLimits = SearchLimits()) -> Plan:
    outcome = checked_plan.plan_problem(problem, limits)
    assert isinstance(outcome, Found)
    return outcome.plan


def said(sentence: str) -> Plan:
    return planned(checked_plan.problem_of("themse", command=sentence))


@pytest.mark.parametrize(
    "sentence",
    [
        "store all probes",
        "close the flap",
        "store probe 1, then close the flap",
        "close the drawer, then close the flap and lock the freezer, then store all probes",
        "put the lid on the freezer, then lock the freezer",
    ],
)
def test_a_sentence_about_what_holds_has_no_steps(sentence: str) -> None:
    assert said(sentence).steps == ()


def test_a_closed_flap_is_not_opened_to_be_closed() -> None:
    alone = said("cool probe 1 for 5 min and store it again")
    closed = said("cool probe 1 for 5 min and store it again, then close the flap")
    assert closed.cost == alone.cost
    assert not any(step.operator.name == "press_switch" for step in closed.steps)


def test_what_does_not_hold_when_its_turn_comes_is_done() -> None:
    assert [s.operator.name for s in said("open the flap, then close the flap").steps] == [
        "press_switch"
    ] * 2
    assert said("heat probe 1 for 15 min and store it again, then close the flap").cost == 10


UNDONE_LATER = {
    "open the drawer, heat probe 1 for 10 min, then close the drawer": (
        "open_drawer",
        "heat",
        "close_drawer",
    ),
    "open the drawer, heat probe 1 for 10 min and close the drawer": (
        "open_drawer",
        "heat",
        "close_drawer",
    ),
    "close the drawer once probe 1 is heated for 5 min, but open the drawer first": (
        "open_drawer",
        "heat",
        "close_drawer",
    ),
    "close the drawer, heat probe 1 for 5 min, then open the drawer": (
        "close_drawer",
        "heat",
        "open_drawer",
    ),
    "take probe 1 out of the drawer, heat probe 2 for 10 min, then put probe 1 back": (
        "pick(probe_1",
        "heat(probe_2",
        "put(probe_1",
    ),
    "grip probe 1, heat probe 2 for 5 min, store probe 1": (
        "pick(probe_1",
        "heat(probe_2",
        "put(probe_1",
    ),
    "open the flap, read the laser, close the flap": ("press", "sense", "press"),
}


@pytest.mark.parametrize("sentence", UNDONE_LATER)
def test_what_the_sentence_undoes_later_is_undone_after_what_is_said_between(sentence: str) -> None:
    plan = said(sentence)
    names = [str(step.operator) for step in plan.steps]
    places, start = [], 0
    for name in UNDONE_LATER[sentence]:
        start = next(n for n in range(start, len(names)) if names[n].startswith(name)) + 1
        places.append(plan.steps[start - 1].id)
    before = plan.predecessors()
    assert all(one in before[other] for one, other in pairwise(places))


def test_only_the_probes_that_are_elsewhere_are_stored() -> None:
    base = checked_plan.problem_of("themse/in_furnace")
    everyone = checked_plan.problem_of("themse", command="store all probes").chains
    assert planned(replace(base, chains=everyone)).cost == 4


def test_goals_mean_the_same() -> None:
    assert (
        planned(checked_plan.problem_of("themse", "stored(probe_1), position(flap, closed)")).steps
        == ()
    )


@pytest.mark.slow
def test_many_chains_that_begin_with_one_setting_make_no_more_operators() -> None:
    """Each operator that adds a setting had two variants for each chain that waits for it."""
    base = checked_plan.problem_of("themse", command="open the flap, then close the flap")
    flap = Function("position", (Function("flap"), Function("open")))
    heated = [Function("sensed", (Function(name),)) for name in ("distance", "slippage")]
    chains = tuple(Chain(f"c{n}", (flap, heated[n % 2])) for n in range(24))
    task = ground(replace(base, chains=chains))
    assert len(task.operators) < 200
    assert planned(replace(base, chains=chains), SearchLimits(room=None, restarts=0)).cost == 25
