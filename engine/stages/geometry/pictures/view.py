"""A cell with its arms at a configuration: what a picture shows, and what the text beside it says."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.pictures import gltf, svg
from cellwright.engine.stages.geometry.pictures.camera import (
    Camera,
    colours_of,
    looking_at,
    pieces_of,
    triangles_in_world,
)
from cellwright.engine.stages.geometry.pictures.notes import Notes, notes_of
from cellwright.engine.stages.geometry.pictures.surfaces import Surface, surfaces
from cellwright.engine.stages.geometry.reach.reach import Reachability, Unreached
from cellwright.engine.stages.geometry.world.following import following
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import scene_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.configuration import read_configuration
from cellwright.kb.model.cell import Cell
from cellwright.kb.terms import Atom

SIZE = (960, 720)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A world, the contacts in it, and the configurations (n, k) of all joints that the motion passes
    through. The last configuration is that of the world.
    """

    world: World
    contacts: tuple[Contact, ...]
    configurations: Floats


def view_of(
    cell: Cell,
    backend: GeometryBackend,
    configurations: Sequence[str] = (),
    place: str = "",
    facts: Collection[Atom] = (),
) -> View:
    """The cell with each arm at the last configuration given for it, or where it reaches the given place,
    else at rest.

    Bodies are where the facts put them, else where the file puts them. Raises `InvalidInput` for a file that
    cannot be read, and for a place that is unknown or not reached.
    """
    world = following(World.of(cell), facts)
    passed = [world.configuration]
    for text in configurations:
        arm, values = read_configuration(text, cell)
        world = world.moved(arm, np.array(values))
        passed.append(world.configuration)
    checker = backend.checker(scene_of(world))
    if place:
        world, checker = _at(world, backend, place)
        passed.append(world.configuration)
    contacts = checker.contacts(world.configuration)
    return View(world, contacts, np.stack(passed))


def _at(world: World, backend: GeometryBackend, name: str) -> tuple[World, CollisionChecker]:
    """The world with an arm at a place, and a checker that knows what may touch there.

    The tool that it needs there is in its hand.
    """
    places = world.cell.places
    if name not in places:
        raise InvalidInput([unknown_name("place", name, places, Source("--place"))])
    reach = Reachability(world, backend)
    answer = reach.at(places[name])
    if isinstance(answer, Unreached):
        message = f"no configuration reaches {name}: {answer.reason}"
        raise InvalidInput([Diagnostic(Source("--place"), "K705", message, answer.hint)])
    arm, tool = places[name].arm, places[name].tool
    away = np.abs(answer.q - world.configurations[arm]).max(axis=1)
    moved = world.moved(arm, answer.q[int(np.argmin(away))])
    return moved.held(tool, arm) if tool else moved, reach.checker(places[name])


def as_png(view: View, azimuth_rad: float, elevation_rad: float) -> bytes:
    """The picture as PNG."""
    from cellwright.engine.stages.geometry.pictures import png

    camera, triangles, shown, notes = _seen(view, azimuth_rad, elevation_rad)
    return png.draw(camera, triangles, colours_of(shown), notes)


def as_svg(view: View, azimuth_rad: float, elevation_rad: float) -> str:
    """The picture as SVG."""
    camera, triangles, shown, notes = _seen(view, azimuth_rad, elevation_rad)
    return svg.draw(camera, triangles, colours_of(shown), pieces_of(shown), notes)


def _seen(
    view: View, azimuth_rad: float, elevation_rad: float
) -> tuple[Camera, Floats, list[Surface], Notes]:
    world = view.world
    shown = surfaces(world, scene_of(world), view.contacts)
    carriers = carrier_poses(world.joints, world.configuration)
    triangles = triangles_in_world(shown, carriers)
    camera = looking_at(triangles.reshape(-1, 3), SIZE, azimuth_rad, elevation_rad)
    return camera, triangles, shown, notes_of(camera, shown, carriers, view.contacts)


def as_gltf(view: View, step_s: float = 1.0) -> str:
    """The scene as glTF. It moves from rest through every given configuration, one after each time step."""
    world, passed = view.world, view.configurations
    passed = passed if len(passed) > 1 else passed[-1:]
    times: Floats = np.arange(len(passed), dtype=float) * step_s
    shown = surfaces(world, scene_of(world), view.contacts)
    return gltf.document(shown, world.joints, times, passed)


def content(view: View) -> dict[str, Any]:
    """The arms, tools and contacts of a view, for JSON: joint values in rad and m, poses as position and
    roll, pitch, yaw.
    """
    return {
        "cell": view.world.cell.name,
        "arms": {name: _arm(view.world, name) for name in view.world.cell.arms},
        "contacts": [
            {
                "between": [contact.first, contact.second],
                "depth_m": contact.depth_m,
                "points": [contact.point_first.tolist(), contact.point_second.tolist()],
            }
            for contact in view.contacts
        ],
    }


def _arm(world: World, name: str) -> dict[str, Any]:
    q, model = world.configurations[name], world.models[name]
    pose = transforms.to_pose(world.pose("world", f"{name}.tool"))
    beyond = [
        joint.name
        for index, joint in enumerate(model.arm.joints)
        if not model.within_limits_of(index, float(q[index]))
    ]
    place = {"position_m": list(pose.position_m), "rpy_rad": list(pose.rpy_rad)}
    return {"configuration": q.tolist(), "tool": place, "beyond_limits": beyond}


def text(view: View) -> str:
    """The arms, tools and contacts of a view, as text for people."""
    lines = []
    for name, each in content(view)["arms"].items():
        prismatic = view.world.models[name].joints.prismatic
        shown = [
            f"{value:g} m" if slides else f"{math.degrees(value):.4g}"
            for value, slides in zip(each["configuration"], prismatic, strict=True)
        ]
        x, y, z = each["tool"]["position_m"]
        lines.append(f"{name} at {', '.join(shown)} degrees, its tool at {x:.3f}, {y:.3f}, {z:.3f} m")
        lines += [f"{joint} of {name} is beyond its limits" for joint in each["beyond_limits"]]
    touching = [f"{c.first} and {c.second} overlap by {c.depth_m * 1000:.1f} mm" for c in view.contacts]
    return "\n".join([*lines, *(touching or ["nothing is in collision"])])
