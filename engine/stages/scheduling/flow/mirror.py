"""A flow seen from its end: what is last comes first, and what is taken is given back.

A schedule of the one is a schedule of the other. Where objects may wait, it matters on which side
they do: put on the board as late as they fit, all of them begin before the first is finished.
"""

from collections.abc import Sequence
from dataclasses import replace

from cellwright.engine.model.flow import Act, Course, Flow, Leave, Route, Take, Use


def mirror_flow(flow: Flow) -> Flow | None:
    """The flow from its end; None if objects may not begin at once, if windows or calendars say
    when acts are done, or if ways end differently.
    """
    if flow.has_windows or any(item.release or item.due is not None for item in flow.items):
        return None
    routes = [_mirror_route(route) for route in flow.routes]
    if any(route is None for route in routes):
        return None
    return replace(flow, routes=tuple(route for route in routes if route is not None))


def _mirror_route(route: Route) -> Route | None:
    if not route.layers:
        return route
    ends = {act.after for act in route.layers[-1]}
    if len(ends) != 1:
        return None
    (end,) = ends
    node = {end: 0, 0: end}  # the first node has number 0
    layers = tuple(
        tuple(_mirror_act(act, node) for act in layer) for layer in reversed(route.layers)
    )
    return Route(layers, _kept_places(route), route.stays)


def _kept_places(route: Route) -> tuple[str, ...]:
    """The places that an object has at the end of every way."""
    standing = {0: frozenset(route.held)}
    for layer in route.layers:
        for act in layer:
            if act.before in standing:
                left = frozenset(each.place for each in act.leaves)
                taken = frozenset(each.place for each in act.takes)
                standing[act.after] = standing[act.before] - left | taken
    return tuple(sorted(standing[route.layers[-1][0].after]))


def _mirror_act(act: Act, node: dict[int, int]) -> Act:
    lasts = act.duration
    return replace(
        act,
        before=node.get(act.after, act.after),
        after=node.get(act.before, act.before),
        uses=tuple(Use(each.resource, lasts - each.end, lasts - each.begin) for each in act.uses),
        takes=tuple(Take(each.place, lasts - each.end, lasts - each.left) for each in act.leaves),
        leaves=tuple(
            Leave(each.place, lasts - each.came, lasts - each.begin) for each in act.takes
        ),
    )


def turn_back(flow: Flow, courses: Sequence[Course]) -> tuple[Course, ...]:
    """The courses in a flow that are those in its mirror, with the same makespan."""
    makespan = max((course.end for course in courses), default=0)
    return tuple(_turn_course(flow.route(n), course, makespan) for n, course in enumerate(courses))


def _turn_course(route: Route, course: Course, makespan: int) -> Course:
    pairs = list(zip(course.acts, course.starts, strict=True))[::-1]
    acts = tuple(layer[act.number] for layer, (act, _) in zip(route.layers, pairs, strict=True))
    return Course(acts, tuple(makespan - start - act.duration for act, start in pairs))
