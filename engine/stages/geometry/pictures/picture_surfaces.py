"""Scenes as coloured triangles, and the camera (a parallel projection) that shows them."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.model.geometry import CollisionScene, Contact, ConvexPiece
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.convex_pieces import length_of, primitive_frame
from cellwright.engine.stages.geometry.shapes.hulls import hull_triangles
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

CIRCLE_SIDES = 16  # sides of the polygon that stands for a circle
Colour = tuple[float, float, float]
KIND_COLOURS: dict[str, Colour] = {
    "arm": (0.93, 0.66, 0.24),
    "tool": (0.36, 0.62, 0.45),
    "part": (0.30, 0.55, 0.80),
    "fixture": (0.72, 0.74, 0.77),
    "region": (0.88, 0.84, 0.62),
    "in collision": (0.86, 0.16, 0.16),
}
"""What a colour means, in the order of the legend."""
SECOND_LINK_SHADE = 0.9  # every second link of an arm, so that links can be told apart


@dataclass(frozen=True, slots=True, eq=False)
class PictureSurface:
    """Triangles (m, 3) of vertices (n, 3), fixed to a carrier.

    Their corners run counter-clockwise, seen from outside.
    """

    body: str
    carrier: int
    vertices: Floats
    triangles: Longs
    colour: Colour
    kind: str = "part"  # what the colour means


def scene_surfaces(
    world: GeometricWorld, scene: CollisionScene, contacts: Collection[Contact] = ()
) -> list[PictureSurface]:
    """The surface of every piece of a scene. Bodies in contact have the colour for collisions."""
    hit = {name for contact in contacts for name in (contact.first, contact.second)}
    drawn = []
    for piece in scene.pieces:
        vertices, triangles = mesh_of(piece)
        kind = "in collision" if piece.body in hit else kind_of_body(world, piece.body)
        colour = _body_colour(world, piece.body, kind)
        drawn.append(PictureSurface(piece.body, piece.carrier, vertices, triangles, colour, kind))
    return drawn


def kind_of_body(world: GeometricWorld, body: str) -> str:
    """What a body is, as in `KINDS`."""
    if body in world.cell.bodies:
        return world.cell.bodies[body].kind.value
    return "arm" if body.partition(".")[0] in world.cell.arms else "region"


def _body_colour(world: GeometricWorld, body: str, kind: str) -> Colour:
    red, green, blue = KIND_COLOURS[kind]
    arm, _, link = body.partition(".")
    if kind != "arm" or [link.name for link in world.cell.arms[arm].arm.links].index(link) % 2 == 0:
        return red, green, blue
    return red * SECOND_LINK_SHADE, green * SECOND_LINK_SHADE, blue * SECOND_LINK_SHADE


def mesh_of(piece: ConvexPiece) -> tuple[Floats, Longs]:
    """Vertices (n, 3) in the carrier's frame and triangles (m, 3): grids for round pieces, else
    hulls.

    A single triangle, as of a mesh that stands for its surface, is seen from both sides.
    """
    if len(piece.vertices) == 3:
        return transforms.apply(piece.T_carrier_piece, piece.vertices), np.array(
            [[0, 1, 2], [0, 2, 1]]
        )
    if len(piece.vertices) > 2:
        return transforms.apply(piece.T_carrier_piece, piece.vertices), hull_triangles(
            piece.vertices
        )
    half = length_of(piece) / 2 if len(piece.vertices) == 2 else 0.0
    vertices, triangles = _capsule_surface(piece.radius_m, half)
    return transforms.apply(primitive_frame(piece), vertices), triangles


def _capsule_surface(radius: float, half: float) -> tuple[Floats, Longs]:
    """A tube along z with round ends, as rings from pole to pole.

    The middle ring is there twice: at each end of the cylinder.
    """
    quarter = np.linspace(0.0, math.pi / 2, CIRCLE_SIDES // 4 + 1)
    tilt = np.concatenate([-quarter[::-1], quarter])
    shift = np.where(np.arange(len(tilt)) < len(quarter), -half, half)
    around = np.arange(CIRCLE_SIDES) * 2 * math.pi / CIRCLE_SIDES
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    z = np.repeat((radius * np.sin(tilt) + shift)[:, None], CIRCLE_SIDES, axis=1)[..., None]
    vertices = np.concatenate([radius * np.cos(tilt)[:, None, None] * ring, z], axis=2).reshape(
        -1, 3
    )
    rows, sides = np.meshgrid(np.arange(len(tilt) - 1), np.arange(CIRCLE_SIDES), indexing="ij")
    a, b = rows * CIRCLE_SIDES + sides, rows * CIRCLE_SIDES + (sides + 1) % CIRCLE_SIDES
    quads = np.stack(
        [a, b, b + CIRCLE_SIDES, a, b + CIRCLE_SIDES, a + CIRCLE_SIDES], axis=-1
    ).reshape(-1, 3)
    return vertices, quads


AZIMUTH_RAD, ELEVATION_RAD = math.radians(-60.0), math.radians(28.0)
PICTURE_MARGIN = 0.05  # share of the picture left free on each side
LIGHT_DIRECTION = np.array([0.3, 0.5, 0.81])  # to the light: right, up and towards the viewer
AMBIENT_SHARE = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class PictureCamera:
    """Axes (3, 3) as rows: right, up and towards the viewer; pixels per metre; the world point
    at the picture's middle.
    """

    axes: Floats
    scale: float
    middle: Floats
    width: int
    height: int

    def project(self, points: Floats) -> Floats:
        """For points (..., 3): pixels to the right, pixels down, and metres towards the viewer."""
        seen = (points - self.middle) @ self.axes.T
        x = self.width / 2 + self.scale * seen[..., 0]
        y = self.height / 2 - self.scale * seen[..., 1]
        return np.stack([x, y, seen[..., 2]], axis=-1)

    def shade(self, triangles: Floats) -> Floats:
        """How bright triangles (m, 3, 3) in the world are (m,).

        Triangles that face away are lit as if from behind.
        """
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        seen = (normals / np.where(length > 0, length, 1.0)) @ self.axes.T
        lit: Floats = AMBIENT_SHARE + (1.0 - AMBIENT_SHARE) * np.abs(seen @ LIGHT_DIRECTION)
        return lit


def camera_for_points(
    points: Floats, size: tuple[int, int], azimuth: float, elevation: float
) -> PictureCamera:
    """A camera at an azimuth and an elevation (radians), with all points (n, 3) in the picture."""
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    axes = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
    seen = points @ axes.T if len(points) else np.zeros((1, 3))
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = np.maximum(high - low, 1e-6)
    scale = float((np.array(size) * (1 - 2 * PICTURE_MARGIN) / extent[:2]).min())
    return PictureCamera(axes, scale, ((low + high) / 2) @ axes, *size)


def triangles_in_world(shown: Sequence[PictureSurface], carriers: Floats) -> Floats:
    """The corners (m, 3, 3) of all triangles in the world, for carriers at poses (k + 1, 4, 4)."""
    placed = []
    for surface in shown:
        T = carriers[surface.carrier]
        placed.append((surface.vertices @ T[:3, :3].T + T[:3, 3])[surface.triangles])
    return np.concatenate([np.zeros((0, 3, 3)), *placed])


def colours_of(shown: Sequence[PictureSurface]) -> Floats:
    """The colour of each triangle (m, 3), from 0 to 1."""
    return np.concatenate(
        [
            np.zeros((0, 3)),
            *(np.tile(surface.colour, (len(surface.triangles), 1)) for surface in shown),
        ]
    )


def piece_of_triangles(shown: Sequence[PictureSurface]) -> Longs:
    """The number of the convex piece of each triangle (m,)."""
    piece_numbers: Longs = np.repeat(
        np.arange(len(shown)), [len(surface.triangles) for surface in shown]
    )
    return piece_numbers
