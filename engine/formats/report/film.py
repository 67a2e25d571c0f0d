"""A film of a plan or a run: one animated glTF in which every body moves, or numbered pictures."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.moves.film import Shot
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.pictures import gltf, png
from cellwright.engine.stages.geometry.pictures.camera import (
    Camera,
    colours_of,
    looking_at,
    triangles_in_world,
)
from cellwright.engine.stages.geometry.pictures.notes import notes_of
from cellwright.engine.stages.geometry.pictures.surfaces import Surface, surfaces
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import scene_of

SIZE = (960, 720)


def as_gltf(shots: Sequence[Shot]) -> str:
    """The film as one file: a node for each link and body, which stands where the shots have it."""
    shown = bodies_of(shots[0].world)
    poses = np.stack([poses_of(each.world) for each in shots])
    return gltf.film(shown, names_of(shots[0].world), np.array([each.at_s for each in shots]), poses)


def as_pngs(shots: Sequence[Shot], azimuth_rad: float, elevation_rad: float) -> Iterator[bytes]:
    """A picture of each shot, all by one camera that has everything in view."""
    shown = bodies_of(shots[0].world)
    camera = _camera(shown, [poses_of(each.world) for each in shots], azimuth_rad, elevation_rad)
    colours = colours_of(shown)
    for shot in shots:
        poses = poses_of(shot.world)
        yield png.draw(camera, triangles_in_world(shown, poses), colours, notes_of(camera, shown, poses))


def _camera(shown: Sequence[Surface], poses: Sequence[Floats], azimuth: float, elevation: float) -> Camera:
    corners = [triangles_in_world(shown, each).reshape(-1, 3) for each in poses]
    boxes = np.array([(each.min(axis=0), each.max(axis=0)) for each in corners])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    ends = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return looking_at(low + ends * (high - low), SIZE, azimuth, elevation)


def names_of(world: World) -> list[str]:
    """What can move, in the order of `poses_of`: the world, the carriers of the arms, and the bodies."""
    carriers = [f"carrier {n + 1}" for n in range(world.joints.count)]
    return ["cell", *carriers, *world.cell.bodies]


def poses_of(world: World) -> Floats:
    """The poses (n, 4, 4) in the world of what can move."""
    carriers = carrier_poses(world.joints, world.configuration)
    bodies = [world.pose("world", name) for name in world.cell.bodies]
    return np.stack([*carriers, *bodies])


def bodies_of(world: World) -> list[Surface]:
    """The surfaces of all links and bodies; each body is its own carrier, by its number in `poses_of`."""
    scene, poses = scene_of(world), poses_of(world)
    numbers = {name: 1 + world.joints.count + n for n, name in enumerate(world.cell.bodies)}
    found = []
    for surface in surfaces(world, scene):
        if surface.body not in numbers:
            found.append(surface)
            continue
        own = numbers[surface.body]
        T = transforms.inverse(poses[own]) @ poses[surface.carrier]
        found.append(replace(surface, carrier=own, vertices=transforms.apply(T, surface.vertices)))
    return found
