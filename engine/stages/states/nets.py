"""Assembles the net of a space: places, transitions, colours, joints, counts and regions."""

from collections.abc import Iterator

from cellwright.engine.model.task_space import Growth, Net, Space
from cellwright.engine.stages.states.clusters import Named
from cellwright.engine.stages.states.counting import MOST_STATES, growth, reachable
from cellwright.engine.stages.states.places import Sorted, places
from cellwright.engine.stages.states.regions import regions
from cellwright.engine.stages.states.tokens import bodies, moved_by_hand
from cellwright.engine.stages.states.transitions import transitions


def net_of(space: Space, full: bool = False, most: int = MOST_STATES) -> Net:
    """The net of a space. With `full`, every form is a place. Global states are searched up to `most` of them."""
    graph = reachable(space, most)
    found = places(space, graph, full)
    steps = (
        space.steps
        if graph is None
        else dict.fromkeys(step for following in graph.values() for step, _ in following)
    )
    count: Growth = growth(space, graph)
    return Net(
        space.model.name,
        found.places,
        transitions(space, found, steps),
        {each.name: tuple("+".join(member) for member in each.members) for each in space.types},
        {
            joint: tuple(_handled(space, found, objects))
            for joint, objects in moved_by_hand(space.model).items()
        },
        space.removed,
        count,
        regions(space, graph) if graph is not None else (),
        space.complete and graph is not None,
    )


def _handled(space: Space, found: Sorted, objects: tuple[str, ...]) -> Iterator[str]:
    """The places in which a robot holds one of these objects; all of them if a controller does without."""
    driven = bodies(space.model).driven
    for place in found.places:
        named = Named(space.forms[place.forms[0]].cluster, space.types)
        pairs = [{each.first.instance, each.second.instance} for each in named.contacts.values()]
        kinds = {space.model.objects[each] for each in objects}
        if not objects or any(
            pair & driven and kinds & {space.model.objects[each] for each in pair - driven} for pair in pairs
        ):
            yield place.name
