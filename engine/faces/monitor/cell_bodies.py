"""The bodies of a cell as a page draws them: surfaces, colours, and where each is."""

import hashlib
from collections.abc import Collection, Mapping
from functools import cached_property, lru_cache

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.execution.journal_motions import (
    RestingCell,
    TakenStep,
    world_during,
)
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.pictures import viewer_files
from cellwright.engine.stages.geometry.pictures.picture_surfaces import KIND_COLOURS, kind_of_body
from cellwright.engine.stages.geometry.reach.place_reachability import PlaceReachability
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.cell_model import Cell, Place, Placement
from cellwright.kb.terms import Atom

MAX_CELLS = 8  # that are kept, and arrangements of the bodies of one


class CellBodies:
    """The bodies of a cell, numbered; `key` names the cell in addresses."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.resting = cell, RestingCell(cell)
        self.corners = viewer_files.body_triangles(self.resting.home)
        self.names = tuple(self.corners)
        self._reached: dict[object, PlaceReachability] = {}

    @cached_property
    def files(self) -> tuple[bytes, ...]:
        """Each body as STL, in its own frame."""
        return tuple(
            viewer_files.stl_of_triangles(body_corners) for body_corners in self.corners.values()
        )

    @cached_property
    def key(self) -> str:
        """A name for the surfaces: other surfaces have another."""
        return hashlib.sha256(b"".join(self.files)).hexdigest()[:16]

    @cached_property
    def colours(self) -> dict[str, str]:
        """The colour of each body as HTML writes it."""
        return {
            name: _html_colour(KIND_COLOURS[kind_of_body(self.resting.home, name)])
            for name in self.names
        }

    @cached_property
    def extent(self) -> tuple[Floats, float]:
        """The middle (3,) of everything, and how far it reaches from there (m)."""
        placed = viewer_files.body_poses(self.resting.home, self.names)
        parts = [
            self.corners[n].reshape(-1, 3) @ placed[n][:3, :3].T + placed[n][:3, 3]
            for n in self.names
        ]
        points = np.concatenate(parts) if parts else np.zeros((1, 3))
        low, high = points.min(axis=0), points.max(axis=0)
        return (low + high) / 2, max(0.1, float(np.linalg.norm(high - low)) / 2)

    def poses(self, world: GeometricWorld) -> dict[str, Floats]:
        """T_world_body (4, 4) of each body."""
        return viewer_files.body_poses(world, self.names)

    def world(
        self, taken: Collection[TakenStep], share: float, facts: Collection[Atom]
    ) -> GeometricWorld:
        """The cell when a share of the last motion is over; other arms are where their last
        motions left them.
        """
        if not taken:
            return self.resting.with_facts(frozenset(facts))
        *earlier, last = taken
        if share >= 1.0:  # what has changed since is shown, too
            world = self.resting.with_facts(frozenset(facts))
            earlier = [*earlier, last]
        else:
            world = world_during(self.resting, last, share)
        for arm, q in _last_places(self.resting, earlier).items():
            if share >= 1.0 or arm != moving_arm(last):
                world = world.moved(arm, q)
        return world

    def touching(
        self, world: GeometricWorld, taken: TakenStep | None
    ) -> tuple[tuple[str, str], ...]:
        """The pairs of bodies that touch and must not, with what the step's place allows."""
        name = taken.motion.place if taken is not None else ""
        place = self.cell.places.get(name) or Place("", Placement(), next(iter(self.cell.arms), ""))
        if not self.cell.arms:
            return ()
        contacts = self._reach(world).contacts(place, world.configuration)
        return tuple(dict.fromkeys((contact.first, contact.second) for contact in contacts))

    def _reach(self, world: GeometricWorld) -> PlaceReachability:
        """What is reached where the bodies stand as they do here."""
        key = frozenset(
            (name, at.parent, at.T_parent_frame.round(6).tobytes())
            for name, at in world.placed.items()
        )
        if key not in self._reached:
            while len(self._reached) >= MAX_CELLS:
                self._reached.pop(next(iter(self._reached)))
            self._reached[key] = PlaceReachability(world, geometry_backend())
        return self._reached[key]


def moving_arm(taken: TakenStep) -> str:
    """The arm that moves in a step; empty if none does."""
    legs = getattr(taken.motion, "legs", ())
    return legs[0].arm if legs else ""


def _last_places(resting: RestingCell, taken: Collection[TakenStep]) -> Mapping[str, Floats]:
    """Where each arm was left by its last motion."""
    last = {moving_arm(motion): motion for motion in taken if moving_arm(motion)}
    return {
        arm: world_during(resting, motion, 1.0).configurations[arm] for arm, motion in last.items()
    }


def _html_colour(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


@lru_cache(MAX_CELLS)
def solids_of(target: str) -> CellBodies:
    """The bodies of the cell of a target. Raises `InvalidInput` if there is none."""
    bodies = CellBodies(cell_of(target))
    _SERVED_BODIES[bodies.key] = bodies
    return bodies


_SERVED_BODIES: dict[str, CellBodies] = {}


def bodies_of_key(key: str) -> CellBodies | None:
    """The bodies whose surfaces have this name, if a page shows them."""
    return _SERVED_BODIES.get(key)
