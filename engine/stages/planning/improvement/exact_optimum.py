"""Exact optimum of a small task: a cheapest plan by looking at every state of interest."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.workflow_replay import STAGE_OPERATOR
from cellwright.engine.stages.planning.improvement import cheapest
from cellwright.engine.stages.planning.improvement.cheapest import Cheapest, Words, rows
from cellwright.engine.stages.planning.search_control import STATE_ROOM, StateRoom

WORD_BITS = 32  # bits
MAX_PLAN_COST = 1_000_000  # no search for a plan that may cost more
FIRST, GROWTH = 8_000, 8  # states for which room is made at first, and so many times more
SLICE_EXPANSIONS = 20_000  # expansions between questions whether to stop


@dataclass(frozen=True, slots=True)
class CheapestPlan:
    """Steps of a cheapest plan, internal operators that reach stages left out; None if none is
    cheaper than the bound.
    """

    steps: tuple[GroundOperator, ...] | None


def find_cheapest_plan(
    operators: Sequence[GroundOperator],
    size: int,
    initial: Bits,
    goals: Sequence[Bits],
    bound: int,
    interrupted: Callable[[], bool],
    room: StateRoom = STATE_ROOM,
) -> CheapestPlan | None:
    """A cheapest of all plans that cost less than `bound`; None if that would take too long to find
    out.

    `operators` have no conditional effects; `size` is the number of atoms, `goals` are
    alternatives. Stages are reached as early as possible, unless a goal wants one that is not yet
    reached.
    """
    if bound <= 0:
        return CheapestPlan(None)
    eager = [operator for operator in operators if operator.instance.name == STAGE_OPERATOR]
    if any(reaching.deletes & goal for reaching in eager for goal in goals):
        eager = []  # the goals want a stage not yet reached
    own = (
        operators
        if not eager
        else [operator for operator in operators if operator.instance.name != STAGE_OPERATOR]
    )
    most = min(room.states, room.checks // max(len(own), 1))
    if bound > MAX_PLAN_COST or most < bound:
        return None
    words = (size + WORD_BITS - 1) // WORD_BITS
    every = [*own, *eager]
    needs = rows([operator.preconditions for operator in every], words)
    adds = rows([operator.adds for operator in every], words)
    drops = rows([operator.deletes & ~operator.adds for operator in every], words)
    costs = [operator.cost for operator in every]
    for capacity in _state_capacities(most):
        search = Cheapest(
            words, costs, needs, adds, drops, len(eager), rows(goals, words), bound, capacity
        )
        goal_state = _run_search(search, rows([initial], words), interrupted)
        if goal_state >= 0:
            return CheapestPlan(tuple(own[number] for number in search.path(goal_state)))
        if goal_state == cheapest.NONE:
            return CheapestPlan(None)
        if goal_state == cheapest.MORE:
            return None
    return None


def _state_capacities(most: int) -> Iterator[int]:
    """Numbers of states for which room is made: little at first, as most small tasks need no
    more.
    """
    capacity = FIRST
    while capacity < most:
        yield capacity
        capacity *= GROWTH
    yield most


def _run_search(search: Cheapest, initial: Words, interrupted: Callable[[], bool]) -> int:
    """What the search answers; `MORE` if it was interrupted."""
    search.begin(initial)
    answer = cheapest.MORE
    while answer == cheapest.MORE and not interrupted():
        answer = search.run(SLICE_EXPANSIONS)
    return answer
