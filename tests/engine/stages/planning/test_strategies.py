"""Every strategy agrees with brute force, repeats, and its plans execute."""

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.planning.effect_variants import unconditional_variants
from cellwright.engine.stages.planning.forward.forward_search import ForwardSearch
from cellwright.engine.stages.planning.portfolio import STRATEGIES
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number
from tests.properties.problems import problems, shortest


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
@given(problem=st.one_of(problems(), problems(conditional=True), problems(deductive=True)))
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_every_strategy_agrees_with_brute_force(strategy: str, problem: Problem) -> None:
    try:
        outcome = checked_plan.plan_problem(problem, SearchLimits(strategy=strategy))
    except InvalidInput:
        assume(False)
    assert isinstance(outcome, Infeasible if shortest(problem) is None else Found)


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
@pytest.mark.parametrize(
    "target", ["bulkhead/both_tools", pytest.param("themse/one", marks=pytest.mark.slow)]
)
def test_every_strategy_solves_the_cells_and_repeats(strategy: str, target: str) -> None:
    problem = load_problem(target)
    first, second = (
        checked_plan.plan_problem(problem, SearchLimits(strategy=strategy)) for _ in range(2)
    )
    assert isinstance(first, Found)
    assert isinstance(second, Found)
    assert first.plan == second.plan


def test_a_seed_changes_ties_and_repeats() -> None:
    task = ground(load_problem("bulkhead/both_tools"))
    answers = [plan_task(task, SearchLimits(strategy="forward", seed=seed)) for seed in (3, 3, 4)]
    assert all(isinstance(answer, Found) for answer in answers)
    assert answers[0] == answers[1]


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_every_strategy_stops_at_its_limit(strategy: str) -> None:
    task = ground(load_problem("bulkhead/twelve_points"))
    outcome = plan_task(task, SearchLimits(expansions=3, strategy=strategy))
    assert isinstance(outcome, GaveUp)
    assert outcome.limit == "expansions"
    assert outcome.statistics.counts["expanded"] <= 3


@given(st.one_of(problems(), problems(deductive=True)), st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
def test_the_compiled_evaluation_finds_what_is_applicable_and_reachable(
    problem: Problem, data: st.DataObject
) -> None:
    """Against plain sets: applicable operators, and whether the goals can be reached without
    deletes.
    """
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    assume(task.goals)
    operators = unconditional_variants(task)
    state = data.draw(st.integers(0, (1 << len(task.atoms)) - 1))
    search = ForwardSearch(operators, state, task.goals[0], len(task.atoms))
    estimate, applicable, preferred = search.evaluate(search.evaluate.space.packed(state))
    plainly = [
        number for number, operator in enumerate(operators) if operator.preconditions & ~state == 0
    ]
    assert sorted(applicable) == plainly
    assert set(preferred) <= set(plainly)
    reached, before = state, -1
    while reached != before:
        before = reached
        for operator in operators:
            if operator.preconditions & ~reached == 0:
                reached |= operator.adds
    assert (estimate >= 0) == (task.goals[0] & ~reached == 0)
    assert (estimate == 0) == (task.goals[0] & ~state == 0) or estimate < 0
    assert all(0 <= atom < len(task.atoms) for atom in indices(reached))


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_a_goal_that_holds_in_some_way_needs_no_step(strategy: str) -> None:
    problem = checked_plan.problem_of("bulkhead/one_point", goals="holding(t3_746, _)")
    outcome = checked_plan.plan_problem(problem, SearchLimits(strategy=strategy))
    assert isinstance(outcome, Found)
    assert outcome.plan.steps == ()


def hanoi(discs: int) -> GroundTask:
    """The tower of Hanoi: which disc lies on which disc or peg, and what is clear; larger
    things have higher numbers.
    """
    things = range(discs + 3)
    atoms = [Function("clear", (Number(thing),)) for thing in things]
    atoms += [
        Function("on", (Number(disc), Number(below))) for disc in range(discs) for below in things
    ]

    def on(disc: int, below: int) -> int:
        return discs + 3 + disc * (discs + 3) + below

    moves = [
        GroundOperator(
            Function("move", (Number(disc), Number(source), Number(target))),
            bitset([disc, on(disc, source), target]),
            bitset([source, on(disc, target)]),
            bitset([target, on(disc, source)]),
        )
        for disc in range(discs)
        for source in range(disc + 1, discs + 3)
        for target in range(disc + 1, discs + 3)
        if source != target
    ]
    start = bitset([0, discs + 1, discs + 2, *(on(disc, disc + 1) for disc in range(discs))])
    goal = bitset([on(disc, disc + 1 if disc + 1 < discs else discs + 2) for disc in range(discs)])
    return GroundTask(tuple(atoms), tuple(moves), start, (goal,), (1,) * len(atoms), ())


def test_a_roundabout_plan_gives_way_to_a_shorter_one() -> None:
    lengths = {}
    for strategy in ("auto", "backward", "landmarks"):
        outcome = plan_task(hanoi(6), SearchLimits(strategy=strategy))
        assert isinstance(outcome, Found)
        lengths[strategy] = len(outcome.plan.steps)
    assert 63 <= lengths["auto"] <= min(lengths["landmarks"], lengths["backward"])
