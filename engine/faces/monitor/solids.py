"""The bodies of a cell, as a page needs them: surfaces, colours, and where each is."""

import hashlib
from collections.abc import Collection, Mapping
from functools import cached_property, lru_cache

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.execution.retracing import Resting, Taken, world_during
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.pictures import stl
from cellwright.engine.stages.geometry.pictures.surfaces import KINDS, kind_of
from cellwright.engine.stages.geometry.reach.reach import Reachability
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.cell import Cell, Place, Placement
from cellwright.kb.terms import Atom

CELLS = 8  # that are kept, and arrangements of the bodies of one


class Solids:
    """The bodies of a cell, numbered; `key` names the cell in addresses."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.resting = cell, Resting(cell)
        self.corners = stl.corners(self.resting.home)
        self.names = tuple(self.corners)
        self._reached: dict[object, Reachability] = {}

    @cached_property
    def files(self) -> tuple[bytes, ...]:
        """Each body as STL, in its own frame."""
        return tuple(stl.written(each) for each in self.corners.values())

    @cached_property
    def key(self) -> str:
        """A name for the surfaces: other surfaces have another."""
        return hashlib.sha256(b"".join(self.files)).hexdigest()[:16]

    @cached_property
    def colours(self) -> dict[str, str]:
        """The colour of each body as HTML writes it."""
        return {name: _html(KINDS[kind_of(self.resting.home, name)]) for name in self.names}

    @cached_property
    def extent(self) -> tuple[Floats, float]:
        """The middle (3,) of everything, and how far it reaches from there (m)."""
        placed = stl.poses(self.resting.home, self.names)
        parts = [self.corners[n].reshape(-1, 3) @ placed[n][:3, :3].T + placed[n][:3, 3] for n in self.names]
        points = np.concatenate(parts) if parts else np.zeros((1, 3))
        low, high = points.min(axis=0), points.max(axis=0)
        return (low + high) / 2, max(0.1, float(np.linalg.norm(high - low)) / 2)

    def poses(self, world: World) -> dict[str, Floats]:
        """T_world_body (4, 4) of each body."""
        return stl.poses(world, self.names)

    def world(self, taken: Collection[Taken], share: float, facts: Collection[Atom]) -> World:
        """The cell when a share of the last motion is over; other arms are where their last motions left them."""
        if not taken:
            return self.resting.with_facts(frozenset(facts))
        *earlier, last = taken
        if share >= 1.0:  # what has changed since is shown, too
            world = self.resting.with_facts(frozenset(facts))
            earlier = [*earlier, last]
        else:
            world = world_during(self.resting, last, share)
        for arm, q in _left(self.resting, earlier).items():
            if share >= 1.0 or arm != moving_arm(last):
                world = world.moved(arm, q)
        return world

    def touching(self, world: World, taken: Taken | None) -> tuple[tuple[str, str], ...]:
        """The pairs of bodies that touch and must not, with what the step's place allows."""
        name = taken.motion.place if taken is not None else ""
        place = self.cell.places.get(name) or Place("", Placement(), next(iter(self.cell.arms), ""))
        if not self.cell.arms:
            return ()
        found = self._reach(world).contacts(place, world.configuration)
        return tuple(dict.fromkeys((each.first, each.second) for each in found))

    def _reach(self, world: World) -> Reachability:
        """What is reached where the bodies stand as they do here."""
        key = frozenset(
            (name, at.parent, at.T_parent_frame.round(6).tobytes()) for name, at in world.placed.items()
        )
        if key not in self._reached:
            while len(self._reached) >= CELLS:
                self._reached.pop(next(iter(self._reached)))
            self._reached[key] = Reachability(world, geometry_backend())
        return self._reached[key]


def moving_arm(taken: Taken) -> str:
    """The arm that moves in a step; empty if none does."""
    legs = getattr(taken.motion, "legs", ())
    return legs[0].arm if legs else ""


def _left(resting: Resting, taken: Collection[Taken]) -> Mapping[str, Floats]:
    """Where each arm was left by its last motion."""
    last = {moving_arm(each): each for each in taken if moving_arm(each)}
    return {arm: world_during(resting, each, 1.0).configurations[arm] for arm, each in last.items()}


def _html(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * each):02x}" for each in colour)


@lru_cache(CELLS)
def solids_of(target: str) -> Solids:
    """The bodies of the cell of a target. Raises `InvalidInput` if there is none."""
    found = Solids(cell_of(target))
    _SERVED[found.key] = found
    return found


_SERVED: dict[str, Solids] = {}


def known(key: str) -> Solids | None:
    """The bodies whose surfaces have this name, if a page shows them."""
    return _SERVED.get(key)
