"""A task that was grounded once and is asked for parts of its goal, beside brute force for each of them."""

from dataclasses import replace
from itertools import combinations
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from engine.model.outcome import Found, Infeasible
from engine.stages.grounding import ground, ground_parts
from engine.stages.planning import plan
from kb.diagnostics import InvalidInput
from kb.model.conditions import And, Condition, goal_parts
from kb.model.problem import Problem
from tests.properties.problems import CONSTANTS, conditions, problems, shortest
from tests.properties.test_quantities import cases, loaded

DILIGENT = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
FAMILIES = st.one_of(problems(), problems(conditional=True), problems(deductive=True))


@given(FAMILIES, st.lists(conditions(CONSTANTS), min_size=1, max_size=3))
@DILIGENT
def test_a_part_is_reached_exactly_if_brute_force_reaches_it(
    problem: Problem, wanted: list[Condition]
) -> None:
    whole = replace(problem, goal=And(tuple(part for each in wanted for part in goal_parts(each))))
    parts = list(goal_parts(whole.goal))
    try:
        parted = ground_parts(whole)
    except InvalidInput:
        assume(False)
    for count in range(len(parts) + 1):
        for chosen in combinations(range(len(parts)), count):
            task = parted.wanting(chosen)
            assert task is not None
            asked = replace(whole, goal=And(tuple(parts[each] for each in chosen)))
            expected = Infeasible if shortest(asked) is None else Found
            assert isinstance(plan(task), expected)


@given(cases())
@DILIGENT
def test_parts_of_goals_with_quantities_agree_with_a_task_for_each(case: tuple[str, str]) -> None:
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
    parts = list(goal_parts(problem.goal))
    parted = ground_parts(problem)
    for number, part in enumerate(parts):
        task = parted.wanting([number])
        assert task is not None
        alone = ground(replace(problem, goal=And((part,))))
        assert type(plan(task)) is type(plan(alone))
