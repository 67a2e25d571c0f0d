"""Keeps the schedules of objects placed so far, and places one more object as early as it fits.

For acts that are chosen, everything that is asked of their starts can only be mended by starting
later: what comes before must have ended, a resource must be free, a place must be free from when it
is taken to when it is left, and nothing may stay too long, so it comes later. So there is one
earliest course, which raising starts until all is right finds. A course holds places from end to
end, so that no two objects can wait for each other's places.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.taken import Row, Taken
from cellwright.engine.model.flow import FOREVER, Act, Course, Flow, Route, holds_of_course
from cellwright.kb.model.time_windows import TimeOfWork

Layers = tuple[tuple[Act, ...], ...]
BESIDE = 20  # acts that take as long as what is done beside raising their starts
WIDTH = 6  # beginnings of a course that are kept
USERS = 1 << 30  # acts that may be done at once when a calendar allows it


@dataclass
class Board:
    """The courses that are settled, and what they take."""

    flow: Flow
    courses: dict[int, Course] = field(default_factory=dict)
    rows: dict[tuple[int, tuple[int, ...], bool], Row | None] = field(default_factory=dict)
    straight: dict[tuple[int, frozenset[int]], Layers] = field(default_factory=dict)
    effort: int = 0  # acts whose starts were raised, with what is done beside

    def __post_init__(self) -> None:
        names = (*self.flow.capacity, *self.flow.calendars)
        self.number = {name: n for n, name in enumerate(names)}
        users = [USERS] * len(self.flow.calendars)
        self.taken = Taken([*self.flow.capacity.values(), *users])
        for name, calendar in self.flow.calendars.items():
            for begin, end in _closed_spans(calendar, self.flow.horizon):
                self.taken.add(self.number[name], begin, end, USERS)
        for number in range(len(self.flow.items)):
            self._stand(number, 1)

    def _stand(self, item: int, change: int) -> None:
        """An item that has no course holds its places at the start for ever."""
        for place in self.flow.route(item).held:
            if place in self.number:
                self.taken.add(self.number[place], 0, FOREVER, change)

    def settle(self, item: int, course: Course) -> None:
        """Give an item its course."""
        self._stand(item, -1)
        self._mark(item, course, 1)
        self.courses[item] = course

    def remove(self, item: int) -> Course:
        """Take an item off the board."""
        course = self.courses.pop(item)
        self._mark(item, course, -1)
        self._stand(item, 1)
        return course

    def _mark(self, item: int, course: Course, change: int) -> None:
        if course.acts:
            number = self.flow.items[item].route
            row = self._row_of(number, self.flow.route(item), course.acts)
            assert row is not None  # hard windows are kept in some way, or there is no course
            self.taken.mark(row, array("q", course.starts), change)

    def earliest(
        self, item: int, soonest: int = 0, waits: frozenset[int] | None = None
    ) -> Course | None:
        """The course that ends first among those found, not begun before `soonest`, and that
        waits nowhere but at `waits`, if they are given.
        """
        own = self.flow.items[item]
        self._stand(item, -1)
        found = self._beam(own.route, self._layers(own.route, waits), max(soonest, own.release))
        self._stand(item, 1)
        return found

    def _layers(self, number: int, waits: frozenset[int] | None) -> Layers:
        route = self.flow.routes[number]
        if waits is None:
            return route.layers
        known = self.straight.get((number, waits))
        if known is None:
            known = self.straight[number, waits] = route.straight(waits)
        return known

    def _beam(self, number: int, layers: Layers, soonest: int) -> Course | None:
        route = self.flow.routes[number]
        kept: list[tuple[tuple[Act, ...], list[int]]] = [((), [])]
        last = len(layers) - 1
        for place, layer in enumerate(layers):
            # nothing is chosen here; what follows finds the times
            if len(layer) == 1 and place < last:
                kept = [
                    ((*acts, layer[0]), starts) for acts, starts in kept if _leads(acts, layer[0])
                ]
                continue
            made = []
            for acts, starts in kept:
                for act in layer:
                    if not _leads(acts, act):
                        continue
                    longer = (*acts, act)
                    begun = [*starts, *[soonest] * (len(longer) - len(starts))]
                    times = self._raised(number, route, longer, begun)
                    if times is not None:
                        made.append((longer, times))
            made.sort(key=lambda each: (each[1][-1] + each[0][-1].duration, sum(each[1])))
            kept = made[:WIDTH]
        return Course(kept[0][0], tuple(kept[0][1])) if kept else None

    def moved(self, item: int, acts: tuple[Act, ...], soonest: int = 0) -> Course | None:
        """The earliest course of these acts."""
        own, route = self.flow.items[item], self.flow.route(item)
        self._stand(item, -1)
        times = self._raised(own.route, route, acts, [max(soonest, own.release)] * len(acts))
        self._stand(item, 1)
        return None if times is None else Course(acts, tuple(times))

    def _raised(
        self, number: int, route: Route, acts: Sequence[Act], starts: Sequence[int]
    ) -> list[int] | None:
        """The least starts that fit, not below these; those that keep windows with a price, if
        there are such. None if there are none.
        """
        if not acts:
            return []
        for strict in (True, False) if _has_prices(route) else (False,):
            self.effort += len(acts) + BESIDE
            row, times = self._row_of(number, route, acts, strict), array("q", starts)
            if row is not None and self.taken.raised(row, times):
                return list(times)
        return None

    def _row_of(
        self, number: int, route: Route, acts: Sequence[Act], strict: bool = False
    ) -> Row | None:
        key = number, tuple([act.number for act in acts]), strict
        if key not in self.rows:
            self.rows[key] = self._row(route, acts, strict)
        return self.rows[key]

    def _row(self, route: Route, acts: Sequence[Act], strict: bool) -> Row | None:
        """What acts use and hold, as numbers, with the windows that have a price if `strict`; None
        if windows contradict each other.
        """
        uses = [
            (n, self.number[use.resource], use.begin, use.end)
            for n, act in enumerate(acts)
            for use in act.uses
            if use.resource in self.number
        ]
        holds = []
        for hold in holds_of_course(acts, route.held):
            most = route.stays.get(hold.place, -1)
            place = self.number.get(hold.place, -1)
            if place >= 0 or most >= 0:
                first = -1 if hold.first is None else hold.first
                last = -1 if hold.last is None else hold.last
                holds.append((place, first, hold.begin, hold.came, last, hold.left, hold.end, most))
        waits = list(waits_of(route, acts, strict))
        durations = [act.duration for act in acts]
        if not _agree(durations, waits):
            return None
        return Row(durations, uses, holds, len(acts) == len(route.layers), waits)


def waits_of(
    route: Route, acts: Sequence[Act], strict: bool = True
) -> Iterator[tuple[int, int, int]]:
    """What the windows of a route ask of the starts of acts: each act starts so long after another
    one. Time 0 is -1. Windows with a price are among them if `strict`.
    """
    for lag in route.lags:
        layers = [-1 if m.layer is None else m.layer for m in (lag.earlier, lag.later)]
        if max(layers) >= len(acts) or (lag.price is not None and not strict):
            continue
        one, other = (
            moment.offsets[0 if layer < 0 else acts[layer].number]
            for moment, layer in zip((lag.earlier, lag.later), layers, strict=True)
        )
        yield layers[1], layers[0], lag.least + one - other
        if lag.most is not None:
            yield layers[0], layers[1], other - one - lag.most


def _agree(durations: Sequence[int], waits: Sequence[tuple[int, int, int]]) -> bool:
    """Whether some starts keep all waits (Bellman 1958)."""
    starts = [0] * len(durations)
    for _ in range(len(durations) + 2 if waits else 0):
        before, now = list(starts), 0
        for act, lasts in enumerate(durations):
            starts[act] = max(starts[act], now)
            now = starts[act] + lasts
        for act, other, wait in waits:
            least = wait + (starts[other] if other >= 0 else 0)
            if act < 0 and least > 0:
                return False
            if act >= 0:
                starts[act] = max(starts[act], least)
        if starts == before:
            return True
    return not waits


def _has_prices(route: Route) -> bool:
    return any(lag.price is not None for lag in route.lags)


def _closed_spans(calendar: TimeOfWork, horizon: int) -> Iterator[tuple[int, int]]:
    """The times in which a calendar allows nothing; after a horizon that is for ever."""
    now = 0
    for first, last in calendar.open_spans(horizon):
        if first > now:
            yield now, first
        now = max(now, last)
    if now < FOREVER:
        yield now, FOREVER


def _leads(acts: Sequence[Act], act: Act) -> bool:
    """Whether an act begins where the acts before it lead."""
    return act.before == (acts[-1].after if acts else 0)


def spans(course: Course, held: Sequence[str]) -> list[tuple[str, int, int]]:
    """Each resource and place that a course takes, from when to when."""
    found = [
        (use.resource, start + use.begin, start + use.end)
        for act, start in zip(course.acts, course.starts, strict=True)
        for use in act.uses
    ]
    for hold in holds_of_course(course.acts, held):
        begin = 0 if hold.first is None else course.starts[hold.first] + hold.begin
        end = FOREVER if hold.last is None else course.starts[hold.last] + hold.end
        found.append((hold.place, begin, end))
    return found
