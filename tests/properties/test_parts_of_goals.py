"""A task that was grounded once and is asked for parts of its goal, beside brute force for each
of them.
"""

from dataclasses import replace
from itertools import combinations, product
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.stages.grounding import ground, ground_parts, has_separable_chains
from cellwright.engine.stages.planning import plan_task
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import And, Condition, goal_parts
from cellwright.kb.model.domain_model import Effect, Kind, Predicate
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Function
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
            assert isinstance(plan_task(task), expected)


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
        assert type(plan_task(task)) is type(plan_task(alone))


HAPPENED = [Function("v", (each,)) for each in CONSTANTS]
STAGES = [
    *HAPPENED,
    *(Function(name, (each,)) for name in ("p", "q") for each in CONSTANTS),
    Function("r"),
]


@st.composite
def chained(draw: st.DrawFn) -> Problem:
    """A random problem whose steps let events happen, with two chains of events and fluents."""
    problem = draw(FAMILIES)
    happening = st.lists(st.sampled_from(HAPPENED), max_size=1)
    operators = tuple(
        replace(each, effects=(*each.effects, *(Effect(event, True) for event in draw(happening))))
        for each in problem.domain.operators
    )
    predicates = {**problem.domain.predicates, "v": Predicate("v", ("thing",), Kind.EVENT)}
    stages = st.lists(st.sampled_from(STAGES), min_size=1, max_size=3)
    chains = tuple(Chain(name, tuple(draw(stages))) for name in ("one", "other"))
    domain = replace(problem.domain, operators=operators, predicates=predicates)
    return replace(problem, domain=domain, chains=chains)


@given(chained())
@DILIGENT
def test_chains_up_to_any_stage_agree_with_a_task_for_each(problem: Problem) -> None:
    assume(has_separable_chains(problem))
    try:
        parted = ground_parts(problem)
    except InvalidInput:
        assume(False)
    parts = range(len(list(goal_parts(problem.goal))))
    for cut in product(*(range(len(chain.stages) + 1) for chain in problem.chains)):
        stages = {
            chain.name: count for chain, count in zip(problem.chains, cut, strict=True) if count
        }
        chains = tuple(
            replace(chain, stages=chain.stages[: stages[chain.name]])
            for chain in problem.chains
            if chain.name in stages
        )
        task = parted.wanting(parts, stages)
        assert task is not None
        assert type(plan_task(task)) is type(plan_task(ground(replace(problem, chains=chains))))
