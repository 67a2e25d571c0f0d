"""Touches that are declared go no deeper than is declared: the checker for paths on which they may occur anywhere."""

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats, Scene, Truths
from cellwright.engine.ports import CollisionChecker


class Shallow:
    """A scene in which the pairs of `meeting` may overlap by `depth_m` (m), and those of `apart` not at all."""

    def __init__(self, apart: CollisionChecker, meeting: CollisionChecker, depth_m: float) -> None:
        self._apart, self._meeting, self._depth_m = apart, meeting, depth_m

    @property
    def scene(self) -> Scene:
        """The scene of the pairs that may not touch."""
        return self._apart.scene

    def collides(self, where: Floats) -> Truths:
        """Whether something touches that must not, or goes deeper than it may (n,)."""
        hits = self._apart.collides(where)
        if not hits.all():
            left = np.nonzero(~hits)[0]
            hits[left] = -self._meeting.clearance(where[left], 0.0) > self._depth_m
        return hits

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """How far everything is from what it must not do (n,), m: from a touch, or from being too deep."""
        met = self._meeting.clearance(where, max(0.0, beyond_m - self._depth_m)) + self._depth_m
        found: Floats = np.minimum(self._apart.clearance(where, beyond_m), met)
        return found

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """What is nearer than `within_m` and must not be, or deeper than it may be, in one configuration: the deepest first."""
        deep = [each for each in self._meeting.contacts(where) if each.depth_m > self._depth_m]
        found = (*self._apart.contacts(where, within_m), *deep)
        return tuple(sorted(found, key=lambda each: each.distance_m)) if deep else found
