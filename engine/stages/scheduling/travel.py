"""How soon a resource can be at another place: the shortest ways, also those by other places or its own work."""

import itertools
from collections.abc import Iterator, Mapping

from cellwright.engine.model.shop import Resource, Shop

Table = Mapping[tuple[str, str], int]


def shortest(shop: Shop, resource: Resource) -> Table:
    """The least time from any place to any other (Floyd & Warshall).

    Work that ends at another place is a way, too.
    """
    if not resource.travel:
        return {}
    moves = list(_moves(shop, resource))
    between = sorted({place for one, other, _ in moves for place in (one, other)})
    places = sorted({resource.home, *between})  # if nothing is done at home, no way leads through it
    best = {(a, b): 0 if a == b else resource.travel.get((a, b), 0) for a in places for b in places}
    for one, other, lasts in moves:
        best[one, other] = min(best[one, other], lasts)
    for middle, a, b in itertools.product(between, places, places):
        best[a, b] = min(best[a, b], best[a, middle] + best[middle, b])
    return best


def has_shortcuts(shop: Shop, resource: Resource) -> bool:
    """Whether some way by other places or other work is shorter than the table says."""
    best = shortest(shop, resource)
    return any(
        best[a, b] < lasts
        for (a, b), lasts in resource.travel.items()
        if (a, b) in best and (a != b or lasts)
    )


def _moves(shop: Shop, resource: Resource) -> Iterator[tuple[str, str, int]]:
    """Where the work of a resource begins and ends, and how long it lasts."""
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            yield stage.origin, stage.destination, stage.duration
    for device in shop.devices:
        if device.operator == resource.name:
            yield from ((change.origin, change.destination, change.duration) for change in device.changes)
