"""The classic tests of a nonlinear planner; each is named by the property that it proves."""

import itertools
from dataclasses import replace

import pytest

from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.plan_times import object_histories
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding import ground_goals as goal_compilation
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem, with_goals
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function
from tests.places import DOMAINS


def problem(name: str, goals: str = "") -> Problem:
    domain, _, stem = name.partition("/")
    loaded = load_problem(str(DOMAINS / domain / "problems" / f"{stem}.yaml"))
    return with_goals(loaded.domain, goals, loaded) if goals else loaded


def solve(name: str, goals: str = "") -> Outcome:
    return checked_plan.plan_problem(problem(name, goals))


def solved(name: str, goals: str = "") -> Plan:
    outcome = solve(name, goals)
    assert isinstance(outcome, Found)
    return outcome.plan


def names(plan: Plan) -> list[str]:
    return [str(step.operator) for step in plan.steps]


def unordered(plan: Plan, one: str, other: str) -> bool:
    """Whether no order holds between the first steps of two names."""
    before = plan.predecessors()
    a, b = (
        next(step.id for step in plan.steps if str(step.operator) == name) for name in (one, other)
    )
    return a not in before[b] and b not in before[a]


def test_the_sussman_anomaly_is_solved_in_three_steps_by_interleaving_its_goals() -> None:
    assert names(solved("blocks/sussman")) == [
        "to_table(c, a)",
        "move(b, table, c)",
        "move(a, table, b)",
    ]


def test_a_tower_is_inverted_without_a_wasted_move() -> None:
    assert len(solved("blocks/inversion").steps) == 4


def test_registers_are_exchanged_through_the_spare_one() -> None:
    plan = solved("registers/exchange")
    assert len(plan.steps) == 3
    assert "spare" in names(plan)[0]


def test_without_a_spare_register_the_exchange_is_proved_impossible() -> None:
    assert isinstance(solve("registers/no_spare"), Infeasible)


def test_a_goal_reached_on_the_way_costs_no_step_of_its_own() -> None:
    assert names(solved("workshop/empty", "warm, seen")) == ["light_fire", "look"]


def test_two_arms_work_without_an_order_between_them() -> None:
    plan = solved("workshop/empty", "done(bolt), done(plate)")
    assert unordered(plan, "take(left, bolt)", "take(right, plate)")
    assert unordered(plan, "treat(left, bolt)", "treat(right, plate)")


def test_deduction_reaches_three_rules_deep() -> None:
    assert names(solved("workshop/empty", "humming")) == ["switch_on"]


def test_what_a_deduced_fact_denies_is_ordered_away() -> None:
    plan = solved("workshop/empty", "seen, humming")
    assert names(plan).index("switch_on") < names(plan).index("look")
    assert not unordered(plan, "switch_on", "look")


def test_working_on_the_heaviest_goals_first_saves_search_and_the_reverse_costs_it() -> None:
    def expanded(sign: int) -> int:
        base = load_problem("bulkhead/three_stations")
        predicates = {
            name: replace(each, weight=None if each.weight is None else 5 + sign * each.weight)
            for name, each in base.domain.predicates.items()
        }
        outcome = checked_plan.plan_problem(
            replace(base, domain=replace(base.domain, predicates=predicates))
        )
        assert isinstance(outcome, Found)
        return outcome.statistics.counts["expanded"]

    assert expanded(1) < expanded(-1)


def test_weights_left_out_follow_what_an_achiever_needs() -> None:
    task = ground(problem("workshop/empty", "done(bolt), seen"))
    weight = {str(atom): task.weights[number] for number, atom in enumerate(task.atoms)}
    assert weight["done(bolt)"] > weight["held(left, bolt)"]
    assert weight["seen"] > weight["lit"]


def test_a_recursive_derived_predicate_opens_the_way() -> None:
    plan = solved("maze/corridor")
    assert names(plan) == [
        "unlock(d1, r1, r2)",
        "unlock(d2, r2, r3)",
        "unlock(d3, r3, r4)",
        "enter(r4)",
    ]


def test_a_derived_goal_is_reached_through_its_supports() -> None:
    assert set(names(solved("workshop/empty", "usable(bolt)"))) == {"paint(bolt)", "blow(bolt)"}


def test_a_negated_derived_predicate_is_a_condition() -> None:
    assert names(solved("workshop/empty", "idle")) == []
    assert isinstance(solve("workshop/empty", "idle, held(left, bolt)"), Infeasible)


def test_a_negative_goal_is_reached_by_the_cheaper_way() -> None:
    assert names(solved("workshop/dirty", "not dirty(bolt)")) == ["wash(bolt)"]


def test_a_universal_condition_holds_for_every_object() -> None:
    assert names(solved("workshop/empty", "bright")) == ["shine"]
    plan = solved("workshop/dirty", "not dirty(X) : part(X)")
    assert sum(step.cost for step in plan.steps) == 4


def test_either_side_of_a_disjunction_will_do() -> None:
    assert len(solved("workshop/dirty", "bright").steps) == 2
    assert names(solved("workshop/empty", "lit | powered"))[0] in ("light_fire", "switch_on")


def test_an_explicit_delete_gives_way_to_an_add() -> None:
    plan = solved("workshop/empty", "painted(bolt), dry(bolt)")
    assert names(plan) == ["paint(bolt)", "blow(bolt)"]


def test_a_conditional_effect_happens_only_under_its_condition() -> None:
    assert names(solved("workshop/empty", "painted(bolt)"))[0] in ("paint(bolt)", "spray(bolt)")
    plan = solved("workshop/dirty", "painted(bolt), dirty(bolt)")
    assert names(plan) == ["paint(bolt)"]


def test_a_quantified_conditional_effect_cleans_everything_at_once() -> None:
    base = problem("workshop/dirty", "not dirty(bolt), not dirty(plate)")
    cheap = tuple(replace(o, cost=None) if o.name == "sweep" else o for o in base.domain.operators)
    outcome = checked_plan.plan_problem(replace(base, domain=replace(base.domain, operators=cheap)))
    assert isinstance(outcome, Found)
    assert names(outcome.plan) == ["sweep"]


def test_an_event_happens_as_often_and_as_long_as_the_workflow_says() -> None:
    plan = solved("oven/twice")
    baked = [str(step.operator) for step in plan.steps if step.operator.name == "bake"]
    assert baked == ["bake(c1, 600)", "bake(c1, 300)"]
    (history,) = object_histories(problem("oven/twice"), plan)
    assert [str(each.stage) for each in history.happenings] == [
        "baked(c1, 600)", "iced(c1)", "baked(c1, 300)", "at(c1, shelf)",
    ]  # fmt: skip


def test_an_event_that_no_stage_names_cannot_happen() -> None:
    task = ground(problem("oven/no_stage"))
    assert not any(operator.instance.name in ("bake", "ice") for operator in task.operators)


def test_a_chain_waits_for_the_chain_it_comes_after() -> None:
    plan = solved("oven/after")
    before = plan.predecessors()
    first, second = (
        s.id for n in ("c2", "c1") for s in plan.steps if str(s.operator).startswith(f"bake({n}")
    )
    assert first in before[second]


def test_defaults_hold_unless_a_given_fact_denies_them() -> None:
    task = ground(problem("oven/no_stage"))
    initial = set(map(str, task.names(task.initial)))
    assert {"free(grill)", "free(rack)"} <= initial
    assert "free(shelf)" not in initial


def test_goals_with_many_ways_are_met_without_multiplying_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    base = problem("oven/no_stage", "at(_, rack), at(_, grill), free(_)")
    base = replace(
        base, initial=(*base.initial, Function("at", (Function("c2"), Function("grill"))))
    )
    multiplied = checked_plan.plan_problem(base)
    monkeypatch.setattr(goal_compilation, "MAX_GOAL_ALTERNATIVES", 1)
    task = ground(base)
    assert len(task.goals) == 1
    compiled = checked_plan.plan_problem(base)
    assert isinstance(multiplied, Found)
    assert isinstance(compiled, Found)
    assert names(compiled.plan) == names(multiplied.plan) == ["move(c1, shelf, rack)"]
    assert compiled.plan.links


def test_two_ways_to_say_the_same_state_contradict() -> None:
    def fact(cake: str, spot: str) -> Atom:
        return Function("at", (Function(cake), Function(spot)))

    base = problem("oven/no_stage")
    with pytest.raises(InvalidInput, match="K301"):
        checked_plan.plan_problem(replace(base, initial=(fact("c1", "shelf"), fact("c1", "grill"))))


@pytest.mark.parametrize(
    "name", ["blocks/sussman", "workshop/dirty", "maze/corridor", "oven/twice"]
)
def test_the_same_seed_gives_the_same_plan(name: str) -> None:
    assert solved(name) == solved(name)


def test_a_search_without_work_gives_up() -> None:
    outcome = checked_plan.plan_problem(problem("blocks/inversion"), SearchLimits(expansions=0))
    assert not isinstance(outcome, (Found, Infeasible))


@pytest.mark.parametrize(
    ("one", "other"), list(itertools.combinations(["lit", "powered", "painted(bolt)"], 2))
)
def test_independent_goals_stay_unordered(one: str, other: str) -> None:
    plan = solved("workshop/empty", f"{one}, {other}")
    assert all(not step.after for step in plan.steps)
