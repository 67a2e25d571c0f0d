"""Whether a scanner sees the patch that it measures: in range, not too flat, nothing in between.

From each eye of the tool a pyramid stands on the patch; what meets it is in the way. The patch is
lifted a little off the surface that it lies on. The arm that carries the tool and what it holds are
behind the eyes, and are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.world.collision_scene import world_pieces
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Measuring, Place, Sight

PYRAMID_CORNERS = 5  # of a pyramid
ROUNDING_RAD = 1e-9
LIFTED_M = 0.002  # how far the patch is off the surface: what bulges less is not in the way
# corners of a patch of side 1
PATCH_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


@dataclass(frozen=True, slots=True)
class UnseenPatch:
    """Why a patch is not seen, as a sentence for people, and the bodies that are in the way."""

    reason: str
    culprits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PatchView:
    """Where the eyes (e, 3) and the corners of the patch (4, 3) are in the world, and the
    normal of the surface (3,).
    """

    eyes: Floats
    patch: Floats
    normal: Floats

    def box(self) -> tuple[Floats, Floats]:
        """The least and the greatest corner of all that the eyes look through."""
        points = np.concatenate([self.eyes, self.patch])
        return points.min(axis=0), points.max(axis=0)


class StandingPieces:
    """The pieces that may be in the way of the eyes of a tool, packed in the world: all but
    what one arm carries.
    """

    def __init__(self, world: GeometricWorld, arm: str) -> None:
        first = world.first_carriers[arm]
        own = range(first + 1, first + 1 + world.models[arm].joints.count)
        self._pieces = [piece for piece in world_pieces(world) if piece.carrier not in own]
        poses = carrier_poses(world.joints, world.configuration[None])[0]
        rows = [
            transforms.apply(matmul(poses[piece.carrier], piece.T_carrier_piece), piece.vertices)
            for piece in self._pieces
        ]
        counts = np.array([len(row) for row in rows], dtype=np.int64)
        self._counts, self._starts = counts, np.cumsum(counts) - counts
        self._rows = np.concatenate([*rows, np.zeros((PYRAMID_CORNERS, 3))])
        self._near = Separations(self._rows, max(PYRAMID_CORNERS, int(counts.max(initial=1))))
        radii = np.array([piece.radius_m for piece in self._pieces])[:, None]
        self._low = np.array([row.min(axis=0) for row in rows]).reshape(-1, 3) - radii
        self._high = np.array([row.max(axis=0) for row in rows]).reshape(-1, 3) + radii

    def between(self, eye: Floats, patch: Floats) -> set[str]:
        """The bodies that meet the pyramid between an eye (3,) and a patch (4, 3)."""
        corners = np.concatenate([eye[None], patch])
        low, high = corners.min(axis=0), corners.max(axis=0)
        self._rows[-PYRAMID_CORNERS:] = corners
        last, culprits = len(self._rows) - PYRAMID_CORNERS, set[str]()
        for n in np.nonzero(((self._low <= high) & (self._high >= low)).all(axis=1))[0]:
            piece, start, count = self._pieces[n], int(self._starts[n]), int(self._counts[n])
            if piece.body not in culprits:
                apart_m = self._near.separation(
                    start, count, piece.radius_m, last, PYRAMID_CORNERS, 0.0
                )
                culprits |= {piece.body} if apart_m < 0.0 else set()
        return culprits


class ScannerSight:
    """What one tool sees in the hand of one arm, in one world, where the tool is declared as a
    scanner.
    """

    def __init__(
        self, world: GeometricWorld, arm: str, tool: str, how: Measuring, sight: Sight
    ) -> None:
        self._world, self._tool, self._how, self._sight = world.held(tool, arm), tool, how, sight
        self._standing = StandingPieces(self._world, arm)
        features = world.cell.bodies[tool].features
        T_tip_tool = transforms.inverse(transforms.of_pose(features["tip"]))
        eyes = [
            matmul(T_tip_tool, transforms.of_pose(features[name]))[:3, 3] for name in sight.eyes
        ]
        self._eyes = np.array(eyes) - np.array([0.0, 0.0, sight.back_m])

    def view(self, place: Place, T_world_tip: Floats) -> PatchView:
        """Where the eyes and the patch are when the tip of the tool is at a pose (4, 4) at a
        place.
        """
        at = place.surface or place.placement
        T = matmul(self._world.pose("world", at.parent), transforms.of_pose(at.pose))
        normal = -T[:3, 2]
        across = T_world_tip[:3, 0] - float(matmul(T_world_tip[:3, 0], normal)) * normal
        x = across / max(norm(across), 1e-9)
        side = place.patch_m or self._how.patch_m[0]
        sides = side * (PATCH_CORNERS[:, :1] * x + PATCH_CORNERS[:, 1:] * np.cross(normal, x))
        eyes: Floats = transforms.apply(T_world_tip, self._eyes)
        return PatchView(eyes, T[:3, 3] + LIFTED_M * normal + sides, normal)

    def unseen(self, place: Place, T_world_tip: Floats) -> UnseenPatch | None:
        """Why the patch at a place is not seen with the tip of the tool at a pose (4, 4); None
        if it is seen.
        """
        view = self.view(place, T_world_tip)
        middle = view.patch.mean(axis=0)
        for name, eye in zip(self._sight.eyes, view.eyes, strict=True):
            rays = np.concatenate([view.patch, middle[None]]) - eye
            if (reason := self._out_of_bounds(name, rays, view.normal)) is not None:
                return reason
        hidden = {
            name: self._standing.between(eye, view.patch)
            for name, eye in zip(self._sight.eyes, view.eyes, strict=True)
        }
        return self._told_hidden({name: culprits for name, culprits in hidden.items() if culprits})

    def _told_hidden(self, hidden: Mapping[str, set[str]]) -> UnseenPatch | None:
        if not hidden:
            return None
        culprits = tuple(sorted(set().union(*hidden.values())))
        are = "is" if len(culprits) == 1 else "are"
        eyes = " and ".join(hidden)
        return UnseenPatch(
            f"{', '.join(culprits)} {are} between it and the {eyes} of {self._tool}", culprits
        )

    def _out_of_bounds(self, eye: str, rays: Floats, normal: Floats) -> UnseenPatch | None:
        """Whether rays (n, 3) from an eye to the patch are too short, too long or too flat."""
        far = np.linalg.norm(rays, axis=1)
        least, most = self._sight.range_m
        if far.min() < least or far.max() > most:
            away = far.min() if far.min() < least else far.max()
            problem = (
                f"the {eye} of {self._tool} is {away:.2f} m from it, and sees from {least:g} to "
                f"{most:g} m"
            )
            return UnseenPatch(problem)
        angle = float(np.arccos((-matmul(rays, normal) / far).clip(-1.0, 1.0)).max())
        if angle > self._sight.incidence_rad + ROUNDING_RAD:
            shown, limit = np.degrees(angle), np.degrees(self._sight.incidence_rad)
            problem = (
                f"the {eye} of {self._tool} looks at it {shown:.0f} degrees off the normal, "
                f"{limit:g} at most"
            )
            return UnseenPatch(problem)
        return None


def best_reason(reasons: Sequence[UnseenPatch | None]) -> UnseenPatch:
    """The reason that is told of several, at least one: a view with something in the way if there
    is one.

    The culprits are all that are in the way in any view.
    """
    given_reasons = [reason for reason in reasons if reason is not None]
    hidden = [reason for reason in given_reasons if reason.culprits]
    culprits = tuple(sorted({name for reason in hidden for name in reason.culprits}))
    return UnseenPatch((hidden or given_reasons)[0].reason, culprits)
