"""A cheapest plan of a small task, by looking at every state that can be reached more cheaply than the goal by a known plan."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.stages import REACHES
from cellwright.engine.model.task import Bits, GroundOperator
from cellwright.engine.stages.planning.improvement import cheapest
from cellwright.engine.stages.planning.improvement.cheapest import Cheapest, Words, rows
from cellwright.engine.stages.planning.limits import ROOM, Room

WORD = 32  # bits
DEAREST = 1_000_000  # no search for a plan that may cost more
FIRST, GROWTH = 8_000, 8  # states for which room is made at first, and so many times more
SLICE = 20_000  # expansions between questions whether to stop


@dataclass(frozen=True, slots=True)
class Optimum:
    """Steps of a cheapest plan, internal operators that reach stages left out; None if none is cheaper than the bound."""

    steps: tuple[GroundOperator, ...] | None


def optimum(
    operators: Sequence[GroundOperator],
    size: int,
    initial: Bits,
    goals: Sequence[Bits],
    bound: int,
    interrupted: Callable[[], bool],
    room: Room = ROOM,
) -> Optimum | None:
    """A cheapest of all plans that cost less than `bound`; None if that would take too long to find out.

    `operators` have no conditional effects; `size` is the number of atoms, `goals` are alternatives. Stages are reached as
    early as possible, unless a goal wants one that is not yet reached.
    """
    if bound <= 0:
        return Optimum(None)
    eager = [each for each in operators if each.instance.name == REACHES]
    if any(each.deletes & goal for each in eager for goal in goals):
        eager = []  # the goals want a stage not yet reached
    own = operators if not eager else [each for each in operators if each.instance.name != REACHES]
    most = min(room.states, room.checks // max(len(own), 1))
    if bound > DEAREST or most < bound:
        return None
    words = (size + WORD - 1) // WORD
    every = [*own, *eager]
    needs = rows([each.preconditions for each in every], words)
    adds = rows([each.adds for each in every], words)
    drops = rows([each.deletes & ~each.adds for each in every], words)
    costs = [each.cost for each in every]
    for capacity in _capacities(most):
        search = Cheapest(words, costs, needs, adds, drops, len(eager), rows(goals, words), bound, capacity)
        found = _run(search, rows([initial], words), interrupted)
        if found >= 0:
            return Optimum(tuple(own[each] for each in search.path(found)))
        if found == cheapest.NONE:
            return Optimum(None)
        if found == cheapest.MORE:
            return None
    return None


def _capacities(most: int) -> Iterator[int]:
    """Numbers of states for which room is made: little at first, as most small tasks need no more."""
    capacity = FIRST
    while capacity < most:
        yield capacity
        capacity *= GROWTH
    yield most


def _run(search: Cheapest, initial: Words, interrupted: Callable[[], bool]) -> int:
    """What the search answers; `MORE` if it was interrupted."""
    search.begin(initial)
    found = cheapest.MORE
    while found == cheapest.MORE and not interrupted():
        found = search.run(SLICE)
    return found
