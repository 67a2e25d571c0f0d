"""Contacts of bodies that are made of several pieces."""

from collections.abc import Iterable

from cellwright.engine.model.geometry import Contact


def nearest_of_bodies(contacts: Iterable[Contact]) -> tuple[Contact, ...]:
    """The nearest contact for each two bodies, in order of distance, then name."""
    best: dict[frozenset[str], Contact] = {}
    for contact in contacts:
        key = frozenset((contact.first, contact.second))
        if key not in best or contact.distance_m < best[key].distance_m:
            best[key] = contact
    return tuple(sorted(best.values(), key=lambda each: (each.distance_m, each.first, each.second)))
