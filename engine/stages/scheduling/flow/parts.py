"""Schedules in which each object is put on the board in parts, cut where it may wait.

Where an object may wait in a place of its own, its parts before and after the wait are coupled by
time alone. So the parts of all objects can come in any order that keeps those of one object in
their order: many first parts, then second and first ones in turns, then the other second ones. A
machine that both parts need is kept busy so from the beginning on.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.flow import Course, Flow, Item, Route
from cellwright.engine.stages.scheduling.flow.board import Board

# how many second parts, then how many first ones, come in turns
TURNS = ((1, 1), (2, 1), (3, 1), (4, 1), (2, 2), (3, 2), (5, 2), (4, 3), (8, 3), (3, 3), (5, 5))
AHEAD = (0, 1, -1, 2, -2, 4, -4, 7)  # first parts more or less than fit before a second one

Word = list[int]  # which part comes next, each of the object that follows in its order


@dataclass(frozen=True)
class PartedFlow:
    """The items of a flow, cut in parts: part `k` of item `n` is item `k * count + n` of `flow`."""

    whole: Flow
    flow: Flow

    @property
    def count(self) -> int:
        """How many whole items there are."""
        return len(self.whole.items)

    def place_parts(self, word: Word) -> list[Course] | None:
        """The courses of the whole items if their parts are put on the board in this order."""
        board, following = Board(self.flow), [0] * len(self.flow.routes)
        for part in word:
            item = part * self.count + following[part]
            following[part] += 1
            soonest = board.courses[item - self.count].end if part else 0
            course = board.earliest(item, soonest)
            if course is None:
                return None
            board.settle(item, course)
        return [self._join_parts(n, board) for n in range(self.count)]

    def _join_parts(self, item: int, board: Board) -> Course:
        """The course of a whole item, with the acts of its route."""
        parts = [board.courses[n] for n in range(item, len(self.flow.items), self.count)]
        numbers = [act.number for part in parts for act in part.acts]
        layers = self.whole.route(item).layers
        acts = tuple(layer[number] for layer, number in zip(layers, numbers, strict=True))
        return Course(acts, tuple(start for part in parts for start in part.starts))

    def words(self) -> Iterator[Word]:
        """The orders that are tried."""
        fit = self._fit()
        for second, first in TURNS:
            for more in AHEAD:
                if 0 < fit + more < self.count:
                    halves = _word(self.count, fit + more, second, first)
                    yield _add_later_parts(halves, len(self.flow.routes))

    def _fit(self) -> int:
        """How many first parts begin before the first of them has ended."""
        board, ends = Board(self.flow), 0
        for item in range(self.count):
            course = board.earliest(item)
            if course is None:
                return 0
            board.settle(item, course)
            ends = ends or course.end
            if course.starts[0] >= ends:
                return item
        return self.count


def _word(count: int, ahead: int, second: int, first: int) -> Word:
    """`ahead` first parts, then turns of so many second and first ones, then the rest; no second
    part comes before its first part.
    """
    word = [0] * ahead
    behind = 0
    while ahead < count:
        seconds, firsts = min(second, ahead - behind), min(first, count - ahead)
        word += [1] * seconds + [0] * firsts
        behind, ahead = behind + seconds, ahead + firsts
    return word + [1] * (count - behind)


def _add_later_parts(word: Word, parts: int) -> Word:
    """The order with later parts as well: each behind the next object's part that it follows."""
    for part in range(2, parts):
        longer, seen = Word(), 0
        for each in word:
            longer.append(each)
            seen += each == part - 1
            if each == part - 1 and seen > 1:
                longer.append(part)
        word = [*longer, part]
    return word


def cut_in_parts(flow: Flow) -> Iterator[PartedFlow]:
    """The ways to cut the items of a flow where they may wait in a place of their own; none where
    windows join parts, or calendars say when acts are done.
    """
    if flow.has_windows or len(flow.routes) != 1 or not flow.items:
        return
    (route,) = flow.routes
    if any(place in flow.capacity or place in route.stays for place in route.held):
        return
    if not all(_is_before(*pair) for pair in itertools.pairwise(flow.items)):
        return
    for many in (1, 2):
        for waits in itertools.combinations(route.waits, many):
            parts = _parts(route, waits)
            if parts is not None:
                items = (
                    Item(own.name, number, own.release, own.due, own.priority)
                    for number in range(len(parts))
                    for own in flow.items
                )
                yield PartedFlow(flow, Flow(parts, tuple(items), flow.capacity))


def _is_before(one: Item, other: Item) -> bool:
    """Whether an item begins and is due no sooner than the one before it."""
    due = (one.due is None) == (other.due is None) and (one.due or 0) <= (other.due or 0)
    return one.release <= other.release and due


def _parts(route: Route, waits: Sequence[int]) -> tuple[Route, ...] | None:
    """The layers between waits; None if objects may wait in several places at once."""
    layers, parts, begin = list(route.straight(waits)), [], 0
    for wait in waits:
        idle = {act.before for act in layers[wait + 1] if act.is_nothing}
        away = {act.before for act in layers[wait + 1]} - idle
        if len(away) != 1:
            return None
        (node,) = away
        layers[wait] = tuple(act for act in layers[wait] if act.after == node)
        layers[wait + 1] = tuple(
            replace(act, before=0) for act in layers[wait + 1] if act.before == node
        )
        parts.append(Route(tuple(layers[begin : wait + 1]), route.held, route.stays))
        begin = wait + 1
    return (*parts, Route(tuple(layers[begin:]), route.held, route.stays))
