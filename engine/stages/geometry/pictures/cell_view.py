"""A cell with its arms at a configuration: its pictures, and the text beside them."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Contact
from cellwright.engine.ports import CollisionChecker, GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.pictures import svg_picture, viewer_files
from cellwright.engine.stages.geometry.pictures.picture_notes import PictureNotes, picture_notes_of
from cellwright.engine.stages.geometry.pictures.picture_surfaces import (
    PictureCamera,
    PictureSurface,
    camera_for_points,
    colours_of,
    piece_of_triangles,
    scene_surfaces,
    triangles_in_world,
)
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.joint_values import read_configuration
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.terms import Atom

PICTURE_SIZE_PX = (960, 720)


@dataclass(frozen=True, slots=True, eq=False)
class CellView:
    """A world, the contacts in it, and the configurations (n, k) of all joints that the motion
    passes through. The last configuration is that of the world.
    """

    world: GeometricWorld
    contacts: tuple[Contact, ...]
    configurations: Floats


def cell_view_of(
    cell: Cell,
    backend: GeometryBackend,
    configurations: Sequence[str] = (),
    place: str = "",
    facts: Collection[Atom] = (),
) -> CellView:
    """The cell with each arm at the last configuration given for it, or where it reaches the given
    place, else at rest.

    Bodies are where the facts put them, else where the file puts them. Raises `InvalidInput` for a
    file that cannot be read, and for a place that is unknown or not reached.
    """
    world = world_after_facts(GeometricWorld.of(cell), facts)
    passed = [world.configuration]
    for text in configurations:
        arm, values = read_configuration(text, cell)
        world = world.moved(arm, np.array(values))
        passed.append(world.configuration)
    checker = backend.checker(collision_scene_of(world))
    if place:
        world, checker = _arm_at_place(world, backend, place)
        passed.append(world.configuration)
    contacts = checker.contacts(world.configuration)
    return CellView(world, contacts, np.stack(passed))


def _arm_at_place(
    world: GeometricWorld, backend: GeometryBackend, name: str
) -> tuple[GeometricWorld, CollisionChecker]:
    """The world with an arm at a place, and a checker that knows what may touch there.

    The tool that it needs there is in its hand.
    """
    places = world.cell.places
    if name not in places:
        raise InvalidInput([unknown_name("place", name, places, Source("--place"))])
    reach = PlaceReachability(world, backend)
    answer = reach.at(places[name])
    if isinstance(answer, UnreachedPlace):
        message = f"no configuration reaches {name}: {answer.reason}"
        raise InvalidInput([Diagnostic(Source("--place"), "K705", message, answer.hint)])
    arm, tool = places[name].arm, places[name].tool
    away = np.abs(answer.q - world.configurations[arm]).max(axis=1)
    moved = world.moved(arm, answer.q[int(np.argmin(away))])
    return moved.held(tool, arm) if tool else moved, reach.checker(places[name])


def view_as_png(view: CellView, azimuth_rad: float, elevation_rad: float) -> bytes:
    """The picture as PNG."""
    from cellwright.engine.stages.geometry.pictures import png_picture

    camera, triangles, shown, notes = _camera_and_notes(view, azimuth_rad, elevation_rad)
    return png_picture.draw_png(camera, triangles, colours_of(shown), notes)


def view_as_svg(view: CellView, azimuth_rad: float, elevation_rad: float) -> str:
    """The picture as SVG."""
    camera, triangles, shown, notes = _camera_and_notes(view, azimuth_rad, elevation_rad)
    return svg_picture.draw_svg(
        camera, triangles, colours_of(shown), piece_of_triangles(shown), notes
    )


def _camera_and_notes(
    view: CellView, azimuth_rad: float, elevation_rad: float
) -> tuple[PictureCamera, Floats, list[PictureSurface], PictureNotes]:
    world = view.world
    shown = scene_surfaces(world, collision_scene_of(world), view.contacts)
    carriers = carrier_poses(world.joints, world.configuration)
    triangles = triangles_in_world(shown, carriers)
    camera = camera_for_points(
        triangles.reshape(-1, 3), PICTURE_SIZE_PX, azimuth_rad, elevation_rad
    )
    return camera, triangles, shown, picture_notes_of(camera, shown, carriers, view.contacts)


def view_as_gltf(view: CellView, step_s: float = 1.0) -> str:
    """The scene as glTF. It moves from rest through every given configuration, one after each
    time step.
    """
    world, passed = view.world, view.configurations
    passed = passed if len(passed) > 1 else passed[-1:]
    times: Floats = np.arange(len(passed), dtype=float) * step_s
    shown = scene_surfaces(world, collision_scene_of(world), view.contacts)
    return viewer_files.gltf_of_motion(shown, world.joints, times, passed)


def view_content(view: CellView) -> dict[str, Any]:
    """The arms, tools and contacts of a view, for JSON: joint values in rad and m, poses as
    position and roll, pitch, yaw.
    """
    return {
        "cell": view.world.cell.name,
        "arms": {name: _arm_content(view.world, name) for name in view.world.cell.arms},
        "contacts": [
            {
                "between": [contact.first, contact.second],
                "depth_m": contact.depth_m,
                "points": [contact.point_first.tolist(), contact.point_second.tolist()],
            }
            for contact in view.contacts
        ],
    }


def _arm_content(world: GeometricWorld, name: str) -> dict[str, Any]:
    q, model = world.configurations[name], world.models[name]
    pose = transforms.to_pose(world.pose("world", f"{name}.tool"))
    beyond = [
        joint.name
        for index, joint in enumerate(model.arm.joints)
        if not model.within_limits_of(index, float(q[index]))
    ]
    place = {"position_m": list(pose.position_m), "rpy_rad": list(pose.rpy_rad)}
    return {"configuration": q.tolist(), "tool": place, "beyond_limits": beyond}


def view_text(view: CellView) -> str:
    """The arms, tools and contacts of a view, as text for people."""
    lines = []
    for name, arm in view_content(view)["arms"].items():
        prismatic = view.world.models[name].joints.prismatic
        shown = [
            f"{value:g} m" if slides else f"{math.degrees(value):.4g}"
            for value, slides in zip(arm["configuration"], prismatic, strict=True)
        ]
        x, y, z = arm["tool"]["position_m"]
        lines.append(
            f"{name} at {', '.join(shown)} degrees, its tool at {x:.3f}, {y:.3f}, {z:.3f} m"
        )
        lines += [f"{joint} of {name} is beyond its limits" for joint in arm["beyond_limits"]]
    touching = [
        f"{c.first} and {c.second} overlap by {c.depth_m * 1000:.1f} mm" for c in view.contacts
    ]
    return "\n".join([*lines, *(touching or ["nothing is in collision"])])
