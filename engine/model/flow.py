"""The flow-scheduling problem: many objects, each on a route of acts, share machines, arms and
places.

A route has layers; one act of each layer is done, one after another. Which one is a choice: another
machine, arm or place. An act leads from one node to another, and the act of the next layer begins
at that node. Times are integers.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.kb.model.time_windows import TimeOfWork

FOREVER = 1 << 40  # later than any time


@dataclass(frozen=True, slots=True)
class Use:
    """One unit of a resource is held from `begin` to `end` of an act, both counted from its
    start.
    """

    resource: str
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Take:
    """A place is taken from `begin` of an act on; the object is there at `came`."""

    place: str
    begin: int
    came: int


@dataclass(frozen=True, slots=True)
class Leave:
    """An object begins to leave a place at `left` of an act; the place is free again at `end`."""

    place: str
    left: int
    end: int


@dataclass(frozen=True, slots=True)
class Act:
    """Steps without a break, from `before` to `after`. A place that is taken is held until an act
    leaves it.

    `number` is its place in its layer.
    """

    name: str
    duration: int
    before: int
    after: int
    number: int = 0
    uses: tuple[Use, ...] = ()
    takes: tuple[Take, ...] = ()
    leaves: tuple[Leave, ...] = ()
    cost: int = 0

    @property
    def is_nothing(self) -> bool:
        """Whether nothing is done."""
        return self.before == self.after and not (
            self.duration or self.uses or self.takes or self.leaves
        )


@dataclass(frozen=True, slots=True)
class RouteMoment:
    """A time in an act of a layer, for each act of it after its start; without a layer the start of
    the plan.
    """

    layer: int | None = None
    offsets: tuple[int, ...] = (0,)


@dataclass(frozen=True, slots=True)
class RouteLag:
    """`later` comes at least `least` and at most `most` after `earlier`, in one course.

    Each unit of time by which it is broken costs `price`, if there is one.
    """

    earlier: RouteMoment
    later: RouteMoment
    least: int
    most: int | None = None
    price: int | None = None

    def breach(self, course: "Course") -> int:
        """By how much a course breaks it."""
        times = [
            0
            if moment.layer is None
            else course.starts[moment.layer] + moment.offsets[course.acts[moment.layer].number]
            for moment in (self.earlier, self.later)
        ]
        lasts = times[1] - times[0]
        return max(0, self.least - lasts, 0 if self.most is None else lasts - self.most)


@dataclass(frozen=True, slots=True)
class Route:
    """Layers of acts from node 0 on.

    `held` are places that the object has at the start, `stays` the longest stays in places, `lags`
    the windows between its acts.
    """

    layers: tuple[tuple[Act, ...], ...]
    held: tuple[str, ...] = ()
    stays: Mapping[str, int] = field(default_factory=dict)
    lags: tuple[RouteLag, ...] = ()

    @property
    def waits(self) -> tuple[int, ...]:
        """The layers after which an object may go on at once or not: an act in which nothing is
        done stands for going on.
        """
        return tuple(
            number - 1
            for number, layer in enumerate(self.layers)
            if number and len(layer) > 1 and any(act.is_nothing for act in layer)
        )

    def straight(self, waits: Collection[int]) -> tuple[tuple[Act, ...], ...]:
        """The layers without the acts that wait, but for `waits`."""
        layers = list(self.layers)
        for number in self.waits:
            if number not in waits:
                idle = tuple(act for act in layers[number + 1] if act.is_nothing)
                nodes = {act.before for act in idle}
                layers[number] = tuple(act for act in layers[number] if act.after in nodes)
                layers[number + 1] = idle
        return tuple(layers)


@dataclass(frozen=True, slots=True)
class Item:
    """An object on a route.

    It begins after `release`; each unit of time after `due` costs `priority`.
    """

    name: str
    route: int
    release: int = 0
    due: int | None = None
    priority: int = 1


@dataclass(frozen=True)
class Flow:
    """Items on routes, and the capacity of each resource and place; what has no capacity is not
    shared. `calendars` are resources that any number of acts may use, when they are open.
    """

    routes: tuple[Route, ...]
    items: tuple[Item, ...]
    capacity: Mapping[str, int]
    calendars: Mapping[str, TimeOfWork] = field(default_factory=dict)

    @property
    def has_windows(self) -> bool:
        """Whether windows of time or calendars say when acts are done."""
        return bool(self.calendars) or any(route.lags for route in self.routes)

    def route(self, item: int) -> Route:
        """The route of an item."""
        return self.routes[self.items[item].route]

    @property
    def horizon(self) -> int:
        """A time by which all is done if it can be, one act after another when calendars allow."""
        work = sum(item.release for item in self.items)
        lasts = [
            sum(max((act.duration for act in layer), default=0) for layer in route.layers)
            + sum(lag.least for lag in route.lags)
            for route in self.routes
        ]
        work += sum(lasts[item.route] for item in self.items)
        return max([work, *(calendar.horizon(work) for calendar in self.calendars.values())])


@dataclass(frozen=True, slots=True)
class Course:
    """The acts that an item does, one of each layer, and when each starts."""

    acts: tuple[Act, ...]
    starts: tuple[int, ...]

    @property
    def end(self) -> int:
        """The end of the last act."""
        return self.starts[-1] + self.acts[-1].duration if self.acts else 0


@dataclass(frozen=True, slots=True)
class Held:
    """A place is held from act `first` (None: from the start) to act `last` (None: for ever) of
    a course.
    """

    place: str
    first: int | None
    begin: int
    came: int
    last: int | None
    left: int
    end: int


def holds_of_course(acts: Sequence[Act], held: Sequence[str]) -> list[Held]:
    """The places that acts one after another hold.

    Places that are taken and not left are held for ever.
    """
    waiting = {place: Held(place, None, 0, 0, None, 0, 0) for place in held}
    found: list[Held] = []
    for number, act in enumerate(acts):
        for leave in act.leaves:
            taken = waiting.pop(leave.place)
            found.append(
                Held(
                    leave.place, taken.first, taken.begin, taken.came, number, leave.left, leave.end
                )
            )
        for take in act.takes:
            waiting[take.place] = Held(take.place, number, take.begin, take.came, None, 0, 0)
    return [*found, *waiting.values()]


@dataclass(frozen=True, slots=True)
class Flowed:
    """The course of each item, in the order of the items; no schedule of these routes is
    shorter than `lower_bound`.
    """

    courses: tuple[Course, ...]
    lower_bound: int = 0
    proved: bool = False

    @property
    def makespan(self) -> int:
        """The end of the last act."""
        return max((course.end for course in self.courses), default=0)


def lateness_of(flow: Flow, courses: Sequence[Course]) -> int:
    """The weighted sum of how late items end."""
    return sum(
        item.priority * max(0, course.end - item.due)
        for item, course in zip(flow.items, courses, strict=True)
        if item.due is not None
    )


def price_of(flow: Flow, courses: Sequence[Course]) -> int:
    """What the windows cost that the courses break."""
    return sum(
        lag.price * lag.breach(course)
        for item, course in zip(flow.items, courses, strict=True)
        for lag in flow.routes[item.route].lags
        if lag.price
    )
