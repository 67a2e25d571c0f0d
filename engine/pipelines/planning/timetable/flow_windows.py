"""What windows and calendars ask of a flow: times between the acts of a route, and resources that
acts may use only when a calendar allows it.

A window has to be about one object of the workflow: one that joins events of several has no route.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.flow import Route, RouteLag, RouteMoment, Use
from cellwright.engine.model.window_breaches import FROM_THE_START, Joining, Occurrence
from cellwright.engine.pipelines.planning.window_keeping import occurrences_in
from cellwright.engine.stages.scheduling.flow.graph import Edge, NoRoute
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.engine.stages.scheduling.window_lags import StepLag, StepMoment, lags_in_order
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import (
    Bindings,
    EventKind,
    EventPattern,
    Side,
    TimeOfWork,
    TimeWindow,
)
from cellwright.kb.terms import Function, Term, term_variables

Layers = Sequence[Sequence[Edge]]


def route_with_windows(problem: Problem, subject: Term, route: Route, edges: Layers) -> Route:
    """The route of an object with the windows between its acts, and with the calendars that its
    acts use. `problem` has this object alone. Raises `NoRoute`.
    """
    lags = _RouteWindows(problem, subject, edges).lags() if problem.all_windows else ()
    return replace(_with_calendars(problem.all_calendars, route, edges), lags=lags)


def calendar_names(calendars: Sequence[TimeOfWork]) -> dict[str, TimeOfWork]:
    """What the resource of each calendar is called."""
    return {f"calendar {number} of {c.of}": c for number, c in enumerate(calendars, 1)}


def _with_calendars(calendars: Sequence[TimeOfWork], route: Route, edges: Layers) -> Route:
    if not calendars:
        return route
    layers = (
        tuple(
            replace(act, uses=(*act.uses, *_open_uses(calendars, edge)))
            for act, edge in zip(acts, own, strict=True)
        )
        for acts, own in zip(route.layers, edges, strict=True)
    )
    return replace(route, layers=tuple(layers))


def _open_uses(calendars: Sequence[TimeOfWork], edge: Edge) -> Iterator[Use]:
    """When an act does what a calendar is about."""
    for name, calendar in calendar_names(calendars).items():
        for stride, begin, end in edge.timed:
            if calendar.covers(stride.operator.instance, stride.operator.resources):
                yield Use(name, begin, begin + 1 if calendar.only_starts else max(end, begin + 1))


@dataclass
class _RouteWindows:
    """The windows on the ways of one object, which are alike on all of them."""

    problem: Problem
    subject: Term
    edges: Layers

    def lags(self) -> tuple[RouteLag, ...]:
        """The windows between the acts. Raises `NoRoute`."""
        known = Semantics(self.problem)
        joined = [self._on_way(known, way) for way in self._ways()]
        if not joined:
            return ()
        shapes = {tuple(_shape(lag) for lag in lags) for lags in joined}
        if len(shapes) > 1:
            raise NoRoute("what a window joins depends on the way of an object")
        return tuple(
            RouteLag(
                self._moment([lags[n].earlier for lags in joined]),
                self._moment([lags[n].later for lags in joined]),
                joined[0][n].least,
                joined[0][n].most,
                joined[0][n].price,
            )
            for n in range(len(joined[0]))
        )

    def _moment(self, ends: Sequence["_WayMoment"]) -> RouteMoment:
        """One end of a window on all ways. Raises `NoRoute`."""
        layer = ends[0].layer
        if layer is None:
            return RouteMoment()
        offsets: dict[int, int] = {}
        for end in ends:
            if offsets.setdefault(end.act, end.offset) != end.offset:
                raise NoRoute("what a window joins depends on the way of an object")
        return RouteMoment(layer, tuple(offsets[n] for n in range(len(self.edges[layer]))))

    def _ways(self) -> Iterator[list[int]]:
        """Ways, each as the number of an act of each layer, so that each act is on one."""
        into = self._ways_into()
        onward = self._ways_onward()
        done = set[tuple[int, ...]]()
        for place, layer in enumerate(self.edges):
            for number, edge in enumerate(layer):
                before, after = into[place].get(edge.before), onward[place + 1].get(edge.after)
                if before is None or after is None:
                    continue
                way = (*before, number, *after)
                if way not in done:
                    done.add(way)
                    yield list(way)

    def _ways_into(self) -> list[dict[int, tuple[int, ...]]]:
        """Before each layer, a way to each node; a node may come before several layers."""
        into: list[dict[int, tuple[int, ...]]] = [{0: ()}]
        for layer in self.edges:
            nodes: dict[int, tuple[int, ...]] = {}
            for number, edge in enumerate(layer):
                if edge.before in into[-1]:
                    nodes.setdefault(edge.after, (*into[-1][edge.before], number))
            into.append(nodes)
        return into

    def _ways_onward(self) -> list[dict[int, tuple[int, ...]]]:
        """Before each layer, a way from each node to the end."""
        last = {edge.after for edge in self.edges[-1]} if self.edges else {0}
        onward: list[dict[int, tuple[int, ...]]] = [dict.fromkeys(last, ())]
        for layer in reversed(self.edges):
            nodes: dict[int, tuple[int, ...]] = {}
            for number, edge in enumerate(layer):
                if edge.after in onward[-1]:
                    nodes.setdefault(edge.before, (number, *onward[-1][edge.after]))
            onward.append(nodes)
        return onward[::-1]

    def _on_way(self, known: Semantics, way: Sequence[int]) -> list["_WayLag"]:
        spots: list[tuple[int, int, int]] = []  # layer, act and begin of each step
        steps = list[Step]()
        for layer, number in enumerate(way):
            for stride, begin, _ in self.edges[layer][number].timed:
                spots.append((layer, number, begin))
                operator = stride.operator
                steps.append(
                    Step(
                        StepId(len(spots)),
                        operator.instance,
                        (),
                        operator.resources,
                        operator.duration,
                        operator.cost,
                    )
                )
        said = occurrences_in(self.problem, Plan(tuple(steps)), known)
        windows = [w for w in self.problem.all_windows if self._is_about(w, said)]
        lasts = [step.duration for step in steps]
        return [_WayLag.of(lag, spots) for lag in lags_in_order(windows, said, lasts)]

    def _is_about(self, window: TimeWindow, said: Sequence[Occurrence]) -> bool:
        """Whether a window is about events of the object.

        Raises `NoRoute` if it may join them with others.
        """
        joining = Joining(said)
        patterns = window.earlier, window.later
        if any(p.kind is EventKind.PLAN and p.side is Side.END for p in patterns):
            raise NoRoute("a window ends with the plan")
        events = [p for p in patterns if p.kind is not EventKind.PLAN]
        own = set.intersection(*(set(term_variables(p.atom)) for p in events)) if events else set()
        any_matches = False
        for pattern in events:
            for occurrence, bound in joining.matching(window, pattern):
                is_old = occurrence.step == FROM_THE_START
                if is_old and not contains_term(occurrence.atom, self.subject):
                    continue
                any_matches = True
                values = {v: value for v, value in bound.items() if v in own}
                if len(events) > 1 and not self._is_told(pattern, values):
                    raise NoRoute("a window joins what is done with several objects")
        return any_matches

    def _is_told(self, pattern: EventPattern, values: Bindings) -> bool:
        named = Function("", (*values.values(), *pattern.atom.arguments))
        return contains_term(named, self.subject)


@dataclass(frozen=True, slots=True)
class _WayMoment:
    layer: int | None
    act: int
    offset: int

    @classmethod
    def of(cls, moment: StepMoment, spots: Sequence[tuple[int, int, int]]) -> "_WayMoment":
        if moment.step < 0:
            return cls(None, 0, 0)
        layer, act, begin = spots[moment.step]
        return cls(layer, act, begin + moment.offset)


@dataclass(frozen=True, slots=True)
class _WayLag:
    earlier: _WayMoment
    later: _WayMoment
    least: int
    most: int | None
    price: int | None

    @classmethod
    def of(cls, lag: StepLag, spots: Sequence[tuple[int, int, int]]) -> "_WayLag":
        earlier, later = _WayMoment.of(lag.earlier, spots), _WayMoment.of(lag.later, spots)
        return cls(earlier, later, lag.least, lag.most, lag.price)


def _shape(lag: _WayLag) -> tuple[object, ...]:
    return lag.earlier.layer, lag.later.layer, lag.least, lag.most, lag.price
