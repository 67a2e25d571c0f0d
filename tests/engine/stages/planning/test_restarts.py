"""Short searches by chance."""

from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.forward.forward_search import (
    SHORTEST_RUN_EXPANSIONS,
    ForwardSearch,
    RestartingSearch,
    luby_number,
    start_forward_search,
)
from cellwright.engine.stages.planning.search_control import Effort
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from tests.engine.stages.planning.test_strategies import hanoi
from tests.properties.problems import problems, shortest


def lengths(known: int) -> list[int]:
    """The sequence as Luby, Sinclair & Zuckerman define it: twice what came before, then the
    next power of two.
    """
    found: list[int] = []
    while len(found) < known:
        found = [*found, *found, 2 * max(found) if found else 1]
    return found[:known]


def test_lengths_are_those_of_luby() -> None:
    assert lengths(7) == [1, 1, 2, 1, 1, 2, 4]
    assert [luby_number(number) for number in range(1, 200)] == lengths(199)


@given(st.one_of(problems(), problems(conditional=True), problems(deductive=True)))
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_short_searches_agree_with_brute_force(problem: Problem) -> None:
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    assume(task.goals)
    answer = runs_of(task).run(Effort(100_000))
    assert answer is not None
    assert (answer.steps is None) == (shortest(problem) is None)


def runs_of(task: GroundTask) -> RestartingSearch:
    """Runs with and without landmarks."""
    searches = [start_forward_search(task, 0), start_forward_search(task, 0, landmarks=True)]
    return RestartingSearch([lambda: searches[0], lambda: searches[1]])


def test_a_run_that_is_interrupted_goes_on_where_it_was() -> None:
    task = ground(problem_of("bulkhead/both_tools"))
    whole, parts = Effort(100_000), Effort(0)
    at_once, bit_by_bit = runs_of(task).run(whole), None
    runs = runs_of(task)
    while bit_by_bit is None:
        parts.limit += 3
        bit_by_bit = runs.run(parts)
    assert at_once is not None
    assert bit_by_bit.steps == at_once.steps
    assert parts.expanded == whole.expanded


def test_a_run_is_given_up_after_its_length_and_the_next_one_begins_anew() -> None:
    task, begun = hanoi(10), list[int]()  # no plan has fewer than 1023 steps

    class Watched(ForwardSearch):
        def again(self, seed: int) -> ForwardSearch:
            begun.append(seed)
            return super().again(seed)

    search = Watched(task.operators, task.initial, task.goals[0], len(task.atoms))
    runs = RestartingSearch([lambda: search])
    effort = Effort(0)
    for expansions, number in (
        (1, 1),
        (SHORTEST_RUN_EXPANSIONS, 1),
        (SHORTEST_RUN_EXPANSIONS + 1, 2),
        (4 * SHORTEST_RUN_EXPANSIONS, 3),
        (4 * SHORTEST_RUN_EXPANSIONS + 1, 4),
    ):
        effort.limit = expansions
        assert runs.run(effort) is None
        assert begun == list(range(1, number + 1))
