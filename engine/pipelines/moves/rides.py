"""Rides: a body goes along its joint and takes an arm with it, while the arm rests."""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.motion import FINEST_M
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.world.scenes import riding_scene_of

LOOKS = 65  # places of a ride at which contacts are looked for, before the whole ride is proved


@dataclass(frozen=True, slots=True, eq=False)
class Ride:
    """A body on its way from one value of its joint to another, in a scene whose first joint is that one."""

    ground: Ground
    first: float
    last: float

    @classmethod
    def of(cls, room: Room, body: str, first: float, last: float) -> "Ride":
        """The ride of a body in a room."""
        return cls(Ground(room.backend.checker(riding_scene_of(room.world, body))), first, last)

    def touched(self, q: Floats) -> tuple[str, ...]:
        """The bodies that touch somewhere on the ride while all arms rest at a configuration (k,); those of the first place."""
        along = self._along(q, LOOKS)
        hits = self.ground.collides(along)
        if not hits.any():
            return ()
        contacts = self.ground.contacts(along[int(np.argmax(hits))])
        return tuple(sorted({name for each in contacts for name in (each.first, each.second)}))

    def proved(self, q: Floats) -> bool:
        """Whether nothing touches anywhere on the ride."""
        return bool(proved(self.ground.proof(0.0, FINEST_M), self._along(q, 2)) == 1)

    def _along(self, q: Floats, count: int) -> Floats:
        values = np.linspace(self.first, self.last, count)[:, None]
        return np.ascontiguousarray(np.hstack([values, np.repeat(q[None], count, axis=0)]))
