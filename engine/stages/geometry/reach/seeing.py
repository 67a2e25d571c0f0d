"""Whether a scanner sees the patch that it measures: from its range, not too flat, and with nothing in between.

From each eye of the tool a pyramid stands on the patch; what meets it is in the way. The patch is lifted a little off the
surface that it lies on. The arm that carries the tool and what it holds are behind the eyes, and are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import pieces_of
from cellwright.kb.model.cell import Measuring, Place, Sight

CORNERS = 5  # of a pyramid
ROUNDING_RAD = 1e-9
LIFTED_M = 0.002  # how far the patch is off the surface: what bulges less is not in the way
SIGNS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])  # corners of a patch of side 1


@dataclass(frozen=True, slots=True)
class Unseen:
    """Why a patch is not seen, as a sentence for people, and the bodies that are in the way."""

    reason: str
    culprits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where the eyes (e, 3) and the corners of the patch (4, 3) are in the world, and the normal of the surface (3,)."""

    eyes: Floats
    patch: Floats
    normal: Floats

    def box(self) -> tuple[Floats, Floats]:
        """The least and the greatest corner of all that the eyes look through."""
        points = np.concatenate([self.eyes, self.patch])
        return points.min(axis=0), points.max(axis=0)


class Standing:
    """The pieces that may be in the way of the eyes of a tool, packed in the world: all but what one arm carries."""

    def __init__(self, world: World, arm: str) -> None:
        first = world.first_carriers[arm]
        own = range(first + 1, first + 1 + world.models[arm].joints.count)
        self._pieces = [piece for piece in pieces_of(world) if piece.carrier not in own]
        poses = carrier_poses(world.joints, world.configuration[None])[0]
        rows = [
            transforms.apply(matmul(poses[each.carrier], each.T_carrier_piece), each.vertices)
            for each in self._pieces
        ]
        counts = np.array([len(each) for each in rows], dtype=np.int64)
        self._counts, self._starts = counts, np.cumsum(counts) - counts
        self._rows = np.concatenate([*rows, np.zeros((CORNERS, 3))])
        self._near = Separations(self._rows, max(CORNERS, int(counts.max(initial=1))))
        radii = np.array([each.radius_m for each in self._pieces])[:, None]
        self._low = np.array([each.min(axis=0) for each in rows]).reshape(-1, 3) - radii
        self._high = np.array([each.max(axis=0) for each in rows]).reshape(-1, 3) + radii

    def between(self, eye: Floats, patch: Floats) -> set[str]:
        """The bodies that meet the pyramid between an eye (3,) and a patch (4, 3)."""
        corners = np.concatenate([eye[None], patch])
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._rows[-CORNERS:] = corners
        last, found = len(self._rows) - CORNERS, set[str]()
        for n in np.nonzero(((self._low <= high) & (self._high >= low)).all(axis=1))[0]:
            piece, start, count = self._pieces[n], int(self._starts[n]), int(self._counts[n])
            if piece.body not in found:
                apart_m = self._near.separation(start, count, piece.radius_m, last, CORNERS, 0.0)
                found |= {piece.body} if apart_m < 0.0 else set()
        return found


class Seeing:
    """What one tool sees in the hand of one arm, in one world, where the tool is declared as a scanner."""

    def __init__(self, world: World, arm: str, tool: str, how: Measuring, sight: Sight) -> None:
        self._world, self._tool, self._how, self._sight = world.held(tool, arm), tool, how, sight
        self._standing = Standing(self._world, arm)
        features = world.cell.bodies[tool].features
        T_tip_tool = transforms.inverse(transforms.of_pose(features["tip"]))
        eyes = [matmul(T_tip_tool, transforms.of_pose(features[name]))[:3, 3] for name in sight.eyes]
        self._eyes = np.array(eyes) - np.array([0.0, 0.0, sight.back_m])

    def view(self, place: Place, T_world_tip: Floats) -> View:
        """Where the eyes and the patch are when the tip of the tool is at a pose (4, 4) at a place."""
        at = place.surface or place.placement
        T = matmul(self._world.pose("world", at.parent), transforms.of_pose(at.pose))
        normal = -T[:3, 2]
        across = T_world_tip[:3, 0] - float(matmul(T_world_tip[:3, 0], normal)) * normal
        x = across / max(norm(across), 1e-9)
        side = place.patch_m or self._how.patch_m[0]
        sides = side * (SIGNS[:, :1] * x + SIGNS[:, 1:] * np.cross(normal, x))
        eyes: Floats = transforms.apply(T_world_tip, self._eyes)
        return View(eyes, T[:3, 3] + LIFTED_M * normal + sides, normal)

    def unseen(self, place: Place, T_world_tip: Floats) -> Unseen | None:
        """Why the patch at a place is not seen with the tip of the tool at a pose (4, 4); None if it is seen."""
        view = self.view(place, T_world_tip)
        middle = view.patch.mean(axis=0)
        for name, eye in zip(self._sight.eyes, view.eyes, strict=True):
            rays = np.concatenate([view.patch, middle[None]]) - eye
            if (said := self._out_of_bounds(name, rays, view.normal)) is not None:
                return said
        hidden = {
            name: self._standing.between(eye, view.patch)
            for name, eye in zip(self._sight.eyes, view.eyes, strict=True)
        }
        return self._told_hidden({name: found for name, found in hidden.items() if found})

    def _told_hidden(self, hidden: Mapping[str, set[str]]) -> Unseen | None:
        if not hidden:
            return None
        culprits = tuple(sorted(set().union(*hidden.values())))
        are = "is" if len(culprits) == 1 else "are"
        eyes = " and ".join(hidden)
        return Unseen(f"{', '.join(culprits)} {are} between it and the {eyes} of {self._tool}", culprits)

    def _out_of_bounds(self, eye: str, rays: Floats, normal: Floats) -> Unseen | None:
        """Whether rays (n, 3) from an eye to the patch are too short, too long or too flat."""
        far = np.linalg.norm(rays, axis=1)
        least, most = self._sight.range_m
        if far.min() < least or far.max() > most:
            away = far.min() if far.min() < least else far.max()
            said = f"the {eye} of {self._tool} is {away:.2f} m from it, and sees from {least:g} to {most:g} m"
            return Unseen(said)
        angle = float(np.arccos((-matmul(rays, normal) / far).clip(-1.0, 1.0)).max())
        if angle > self._sight.incidence_rad + ROUNDING_RAD:
            shown, limit = np.degrees(angle), np.degrees(self._sight.incidence_rad)
            said = (
                f"the {eye} of {self._tool} looks at it {shown:.0f} degrees off the normal, {limit:g} at most"
            )
            return Unseen(said)
        return None


def best(found: Sequence[Unseen | None]) -> Unseen:
    """The reason that is told of several, at least one: a view with something in the way if there is one.

    The culprits are all that are in the way in any view.
    """
    told = [each for each in found if each is not None]
    hidden = [each for each in told if each.culprits]
    culprits = tuple(sorted({name for each in hidden for name in each.culprits}))
    return Unseen((hidden or told)[0].reason, culprits)
