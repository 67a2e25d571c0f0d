"""When a chain may advance, what reaches a stage, what must last; and that planner and checker
mean the same.
"""

from dataclasses import replace

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.domain_model import Domain, Effect, Kind, Operator, Predicate
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import (
    Chain,
    Listed,
    Problem,
    advance_chains,
    final_stages,
    finished_chains,
    initial_progress,
    may_advance,
    next_stages,
    reaches_stage,
    stage_holds,
)
from cellwright.kb.terms import ANYTHING, Function

BAKED, COOLED, SHUT = Function("baked"), Function("cooled"), Function("shut")
FIRST = Chain("first", (BAKED, COOLED), subject=Function("tray"))
SECOND = Chain("second", (SHUT,), after=("first",), subject=Function("tray"))
CHAINS = (FIRST, SECOND)


def domain(*operators: Operator) -> Domain:
    events = {name: Predicate(name, (), Kind.EVENT) for name in ("baked", "cooled")}
    return Domain(
        "oven",
        predicates={**events, "shut": Predicate("shut", (), Kind.FLUENT)},
        operators=operators,
    )


def test_a_chain_waits_until_those_before_it_are_finished() -> None:
    assert list(next_stages(CHAINS, {"first": 1, "second": 0})) == ["first"]
    assert list(next_stages(CHAINS, {"first": 2, "second": 0})) == ["second"]
    assert finished_chains(CHAINS, {"first": 2, "second": 0}) == {"first"}


def test_a_chain_that_has_begun_waits_for_none_and_a_finished_one_stays_finished() -> None:
    assert may_advance(replace(SECOND, stages=(SHUT, SHUT)), 1, ())
    assert not may_advance(FIRST, 2, ("first", "second"))


def test_an_open_place_in_a_stage_stands_for_anything() -> None:
    assert reaches_stage(
        Function("at", (Function("tray"), SHUT)), Function("at", (Function("tray"), ANYTHING))
    )
    assert not reaches_stage(BAKED, COOLED)


def test_an_event_serves_one_chain_and_an_atom_all_that_wait_for_it() -> None:
    twins = [Chain("one", (BAKED,)), Chain("other", (BAKED,)), Chain("third", (SHUT,))]
    none = dict.fromkeys(("one", "other", "third"), 0)
    shut, open_ = stage_holds(Listed([SHUT])), stage_holds(Listed())
    assert advance_chains(twins, none, (BAKED,), shut) == ({"one": 1, "other": 0, "third": 1}, ())
    both = (*twins, replace(twins[2], name="fourth"))
    assert advance_chains(both, {**none, "fourth": 0}, (), shut)[0] == {
        **none,
        "third": 1,
        "fourth": 1,
    }
    assert advance_chains(twins, none, (COOLED,), open_) == (none, (COOLED,))


def test_what_holds_already_is_reached_at_once_however_many_chains_wait_for_it() -> None:
    shut = stage_holds(Listed([SHUT]))
    assert initial_progress(CHAINS, shut) == {"first": 0, "second": 0}
    assert initial_progress((SECOND,), shut) == {"second": 0}  # it waits for one that is not there
    assert initial_progress((replace(SECOND, after=()),), shut) == {"second": 1}
    assert advance_chains(CHAINS, {"first": 1, "second": 0}, (COOLED,), shut)[0] == {
        "first": 2,
        "second": 1,
    }
    last = Chain("third", (SHUT, SHUT), after=("second",))
    assert (
        advance_chains((*CHAINS, last), {"first": 1, "second": 0, "third": 0}, (COOLED,), shut)[0][
            "third"
        ]
        == 2
    )
    anything = Chain("some", (Function("at", (ANYTHING,)),))
    assert initial_progress((anything,), stage_holds(Listed([Function("at", (SHUT,))]))) == {
        "some": 1
    }
    assert initial_progress((anything,), stage_holds(Listed([SHUT]))) == {"some": 0}


def test_the_last_fluent_of_a_subject_lasts_and_no_event_does() -> None:
    assert final_stages(CHAINS, domain()) == {"second": (SHUT,)}
    again = Chain("third", (BAKED,), after=("second",), subject=Function("tray"))
    assert final_stages((*CHAINS, again), domain()) == {}


def test_a_step_moves_a_chain_by_one_stage_whoever_follows_it() -> None:
    """Two events of one step come at one moment, so they are no two stages of one chain:
    planner and checker agree.
    """
    both = Operator("bake_and_cool", (), ALWAYS_TRUE, (Effect(BAKED), Effect(COOLED)))
    problem = Problem("cake", domain(both), chains=(FIRST,), complete=True)
    plan = Plan((Step(StepId(1), Function("bake_and_cool")),))
    assert isinstance(checked_plan.plan_problem(problem), Infeasible)
    assert [each.code for each in validate_plan(problem, plan)] == ["K506"]
    apart = replace(problem, chains=(replace(FIRST, stages=(BAKED,)), Chain("own", (COOLED,))))
    assert isinstance(checked_plan.plan_problem(apart), Found)
    assert validate_plan(apart, plan) == []
