"""Bodies as binary STL, each in its own frame, and where these frames are in a world."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.pictures.surfaces import mesh_of
from cellwright.engine.stages.geometry.world.model import Located, World
from cellwright.engine.stages.geometry.world.scenes import scene_of

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FIXED = Located(0, np.eye(4))  # regions stand still, and have no frame of their own


def located(world: World, names: Iterable[str]) -> dict[str, Located]:
    """The frames of links (`arm.link`), bodies and solid regions, by their names in a scene."""
    links = {
        f"{name}.{link.name}": world.locate_link(name, link)
        for name, mounted in world.cell.arms.items()
        for link in mounted.arm.links
    }
    bodies = world.cell.bodies
    return {name: world.locate(name) if name in bodies else links.get(name, FIXED) for name in names}


def poses(world: World, names: Iterable[str]) -> dict[str, Floats]:
    """T_world_body (4, 4) of links, bodies and solid regions, by their names in a scene."""
    carriers = carrier_poses(world.joints, world.configuration)
    return {
        name: matmul(carriers[at.carrier], at.T_carrier_frame) for name, at in located(world, names).items()
    }


def corners(world: World) -> dict[str, Floats]:
    """The corners (n, 3, 3) of the triangles of everything that has a surface, each in its own frame."""
    pieces, found = scene_of(world).pieces, defaultdict(list)
    frames = located(world, {piece.body: None for piece in pieces})
    for piece in pieces:
        vertices, triangles = mesh_of(piece)
        own = transforms.apply(transforms.inverse(frames[piece.body].T_carrier_frame), vertices)
        found[piece.body].append(own[triangles])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def written(triangles: Floats) -> bytes:
    """Triangles (n, 3, 3) as binary STL."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), dtype=TRIANGLE)
    rows["normal"], rows["corners"] = across / np.maximum(length, 1e-30), triangles
    return bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
