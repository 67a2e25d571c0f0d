"""What a picture shows: every piece of a scene as triangles with a colour; bodies in collision have a colour
of their own.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats, Longs, Piece, Scene
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.hull import hull_triangles
from cellwright.engine.stages.geometry.shapes.primitives import length_of, primitive_frame
from cellwright.engine.stages.geometry.world.model import World

SIDES = 16  # sides of the polygon that stands for a circle
Colour = tuple[float, float, float]
KINDS: dict[str, Colour] = {
    "arm": (0.93, 0.66, 0.24),
    "tool": (0.36, 0.62, 0.45),
    "part": (0.30, 0.55, 0.80),
    "fixture": (0.72, 0.74, 0.77),
    "region": (0.88, 0.84, 0.62),
    "in collision": (0.86, 0.16, 0.16),
}
"""What a colour means, in the order of the legend."""
DARKER = 0.9  # every second link of an arm, so that links can be told apart


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles (m, 3) of vertices (n, 3), fixed to a carrier.

    Their corners run counter-clockwise, seen from outside.
    """

    body: str
    carrier: int
    vertices: Floats
    triangles: Longs
    colour: Colour
    kind: str = "part"  # what the colour means


def surfaces(world: World, scene: Scene, contacts: Collection[Contact] = ()) -> list[Surface]:
    """The surface of every piece of a scene. Bodies in contact have the colour for collisions."""
    hit = {name for contact in contacts for name in (contact.first, contact.second)}
    found = []
    for piece in scene.pieces:
        vertices, triangles = mesh_of(piece)
        kind = "in collision" if piece.body in hit else kind_of(world, piece.body)
        colour = _colour(world, piece.body, kind)
        found.append(Surface(piece.body, piece.carrier, vertices, triangles, colour, kind))
    return found


def kind_of(world: World, body: str) -> str:
    """What a body is, as in `KINDS`."""
    if body in world.cell.bodies:
        return world.cell.bodies[body].kind.value
    return "arm" if body.partition(".")[0] in world.cell.arms else "region"


def _colour(world: World, body: str, kind: str) -> Colour:
    red, green, blue = KINDS[kind]
    arm, _, link = body.partition(".")
    if kind != "arm" or [each.name for each in world.cell.arms[arm].arm.links].index(link) % 2 == 0:
        return red, green, blue
    return red * DARKER, green * DARKER, blue * DARKER


def mesh_of(piece: Piece) -> tuple[Floats, Longs]:
    """Vertices (n, 3) in the carrier's frame and triangles (m, 3): grids for round pieces, else hulls."""
    if len(piece.vertices) > 2:
        return transforms.apply(piece.T_carrier_piece, piece.vertices), hull_triangles(piece.vertices)
    half = length_of(piece) / 2 if len(piece.vertices) == 2 else 0.0
    vertices, triangles = _capsule(piece.radius_m, half)
    return transforms.apply(primitive_frame(piece), vertices), triangles


def _capsule(radius: float, half: float) -> tuple[Floats, Longs]:
    """A tube along z with round ends, as rings from pole to pole.

    The middle ring is there twice: at each end of the cylinder.
    """
    quarter = np.linspace(0.0, math.pi / 2, SIDES // 4 + 1)
    tilt = np.concatenate([-quarter[::-1], quarter])
    shift = np.where(np.arange(len(tilt)) < len(quarter), -half, half)
    around = np.arange(SIDES) * 2 * math.pi / SIDES
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    z = np.repeat((radius * np.sin(tilt) + shift)[:, None], SIDES, axis=1)[..., None]
    vertices = np.concatenate([radius * np.cos(tilt)[:, None, None] * ring, z], axis=2).reshape(-1, 3)
    rows, sides = np.meshgrid(np.arange(len(tilt) - 1), np.arange(SIDES), indexing="ij")
    a, b = rows * SIDES + sides, rows * SIDES + (sides + 1) % SIDES
    quads = np.stack([a, b, b + SIDES, a, b + SIDES, a + SIDES], axis=-1).reshape(-1, 3)
    return vertices, quads
