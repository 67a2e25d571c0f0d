"""The nearest two bodies at each of many configurations, with points, normal and distance, from any checker."""

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.ports import CollisionChecker
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker


def nearest(checker: CollisionChecker, where: Floats, beyond_m: float = 1.0) -> tuple[Contact | None, ...]:
    """For each of a batch (n, ...) the two bodies that are nearest to each other, or overlap deepest.

    None where nothing is nearer than `beyond_m`. The built-in checker answers for the whole batch at once, others one by one.
    Raises `ValueError` for what is no number.
    """
    if isinstance(checker, BuiltinChecker):
        return checker.nearest(where, beyond_m)
    found = (checker.contacts(each, beyond_m) for each in np.asarray(where, dtype=float))
    return tuple(min(each, key=lambda contact: contact.distance_m, default=None) for each in found)
