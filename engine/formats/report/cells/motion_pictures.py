"""Pictures and films of motions: joint values as SVG, scenes that move as glTF, views as PNG."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.formats.report.drawing.colour_palette import assign_colours
from cellwright.engine.formats.report.drawing.plan_svg import INK, PAPER
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import Blocked, Moved
from cellwright.engine.pipelines.motion.arm_motion import ArmMotion
from cellwright.engine.pipelines.motion.step_film import FilmShot
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.pictures import png_picture, viewer_files
from cellwright.engine.stages.geometry.pictures.picture_notes import picture_notes_of
from cellwright.engine.stages.geometry.pictures.picture_surfaces import (
    PictureCamera,
    PictureSurface,
    camera_for_points,
    colours_of,
    scene_surfaces,
    triangles_in_world,
)
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

WIDTH, HEIGHT, MARGIN, LINE = (
    860.0,
    300.0,
    50.0,
    18.0,
)  # pixels; the height is that of one of the two diagrams
DRAWN_MOMENTS = 241  # at which values are drawn


def joint_curves_svg(joints: Sequence[str], times: Floats, values: Floats, speeds: Floats) -> str:
    """The SVG of joint values and speeds (n, k) at times (n,), in s."""
    inks = assign_colours(joints)
    tall = 2 * HEIGHT + LINE * (len(joints) + 1)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="{tall:g}" '
        f'viewBox="0 0 {WIDTH:g} {tall:g}" font-family="sans-serif" font-size="12">',
        f'<rect width="100%" height="100%" fill="{PAPER}"/>',
        *_curve_diagram(times, values, inks, 0.0, "joint values, rad or m"),
        *_curve_diagram(times, speeds, inks, HEIGHT, "joint speeds, rad/s or m/s"),
    ]
    for n, (name, ink) in enumerate(inks.items()):
        lines.append(_svg_text(MARGIN, 2 * HEIGHT + LINE * n, name, ink))
    return "\n".join([*lines, "</svg>"]) + "\n"


def _curve_diagram(
    times: Floats, values: Floats, inks: Mapping[str, str], top: float, title: str
) -> Iterator[str]:
    low, high, whole = float(values.min()), float(values.max()), max(float(times[-1]), 1e-9)
    across, down = (WIDTH - 2 * MARGIN) / whole, (HEIGHT - 2 * MARGIN) / max(high - low, 1e-9)
    x, y = MARGIN + across * times, top + HEIGHT - MARGIN - down * (values - low)
    base, right = top + HEIGHT - MARGIN, WIDTH - MARGIN
    yield (
        f'<path d="M {MARGIN:g},{top + MARGIN:g} V {base:g} H {right:g}" fill="none" '
        f'stroke="{INK}"/>'
    )
    yield _svg_text(MARGIN, top + MARGIN - LINE, title, INK)
    yield _svg_text(4.0, top + MARGIN, f"{high:.2f}", INK)
    yield _svg_text(4.0, base, f"{low:.2f}", INK)
    yield _svg_text(right - LINE, base + LINE, f"{whole:.2f} s", INK)
    for n, ink in enumerate(inks.values()):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in np.column_stack([x, y[:, n]]))
        yield f'<polyline points="{points}" fill="none" stroke="{ink}" stroke-width="1.5"/>'


def _svg_text(x: float, y: float, label: str, ink: str) -> str:
    return f'<text x="{x:g}" y="{y:g}" fill="{ink}">{escape(label)}</text>'


MOTION_PICTURE_SIZE = (960, 720)
MARK_M, MARKS = 0.008, 120  # size and number of the marks on the way of the hand
HAND_WAY_COLOUR = (0.55, 0.15, 0.55)
START_COLOUR_SHARE = 0.45  # how much of its colour the arm has where it starts
FRAME_S = 0.04  # between two pictures of a scene that moves
OCTAHEDRON_CORNERS = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=float
)
OCTAHEDRON_FACES = np.array(
    [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)], dtype=np.int64
)


def motion_svg(motion: ArmMotion) -> str:
    """Joint values and speeds over time."""
    moments = np.linspace(0.0, motion.times.duration_s, DRAWN_MOMENTS)
    values, speeds, _ = motion.times.at(moments)
    return joint_curves_svg(motion.joints, moments, values, speeds)


def motion_gltf(motion: ArmMotion) -> str:
    """The cell, with the arm moving as the trajectory says."""
    count = int(np.ceil(motion.times.duration_s / FRAME_S)) + 1  # one moment, where nothing moves
    moments = np.linspace(0.0, motion.times.duration_s, count)
    whole = np.repeat(motion.whole()[:1], count, axis=0)
    whole[:, motion.own] = motion.times.at(moments)[0]
    scene = motion.ground.scene
    return viewer_files.gltf_of_motion(
        scene_surfaces(motion.world, scene), scene.joints, moments, whole
    )


def motion_png(motion: ArmMotion, azimuth_rad: float, elevation_rad: float) -> bytes:
    """The cell with the arm at both ends of the path, the start paler, and marks where the hand
    passes.

    Without a path: the arm where it starts, or where the way is blocked worst, with what touches
    there. If it is proved that there is none: the arm, beside its start, at what cuts the goal off.
    """
    scene, answer = motion.ground.scene, motion.answer
    ends, contacts = _drawn_configurations(motion)
    shown = scene_surfaces(motion.world, scene, contacts)
    carriers = carrier_poses(scene.joints, ends)
    marks = _hand_marks(motion) if isinstance(answer, Moved) else []
    pale = [
        replace(surface, colour=_paler_colour(surface))
        for surface in shown
        if surface.carrier > 0 and len(ends) > 1
    ]
    drawn = [
        triangles_in_world([*shown, *marks], carriers[-1]),
        triangles_in_world(pale, carriers[0]),
    ]
    triangles = np.concatenate(drawn)
    camera = camera_for_points(
        triangles.reshape(-1, 3), MOTION_PICTURE_SIZE, azimuth_rad, elevation_rad
    )
    colours = colours_of([*shown, *marks, *pale])
    return png_picture.draw_png(
        camera, triangles, colours, picture_notes_of(camera, shown, carriers[-1], contacts)
    )


def _drawn_configurations(motion: ArmMotion) -> tuple[Floats, tuple[Contact, ...]]:
    """The configurations (n, k) that are drawn, and what touches at the last one."""
    answer = motion.answer
    if isinstance(answer, Moved):
        return motion.whole()[[0, -1]], ()
    if isinstance(answer, Blocked) and answer.severed is not None:
        return np.stack([motion.start, answer.severed.at]), answer.severed.contacts
    ends = answer.at[None] if isinstance(answer, Blocked) else np.array([motion.start])
    return ends, motion.ground.contacts(ends[-1])


def _paler_colour(surface: PictureSurface) -> tuple[float, float, float]:
    red, green, blue = (1.0 - START_COLOUR_SHARE * (1.0 - part) for part in surface.colour)
    return red, green, blue


def _hand_marks(motion: ArmMotion) -> list[PictureSurface]:
    """Small octahedra where the hand passes, at even times."""
    moments = np.linspace(0.0, motion.times.duration_s, MARKS)
    whole = np.repeat(motion.whole()[:1], MARKS, axis=0)
    whole[:, motion.own] = motion.times.at(moments)[0]
    points: Floats = motion.hand.poses(whole)[:, :3, 3]
    return [
        PictureSurface(
            "way",
            0,
            point + MARK_M * OCTAHEDRON_CORNERS,
            OCTAHEDRON_FACES,
            HAND_WAY_COLOUR,
            "region",
        )
        for point in points
    ]


FILM_SIZE = (960, 720)


def film_gltf(shots: Sequence[FilmShot]) -> str:
    """The film as one file: a node for each link and body, which stands where the shots have it."""
    shown = bodies_of(shots[0].world)
    poses = np.stack([movable_poses(shot.world) for shot in shots])
    return viewer_files.gltf_of_poses(
        shown, movable_names(shots[0].world), np.array([shot.at_s for shot in shots]), poses
    )


def as_pngs(shots: Sequence[FilmShot], azimuth_rad: float, elevation_rad: float) -> Iterator[bytes]:
    """A picture of each shot, all by one camera that has everything in view."""
    shown = bodies_of(shots[0].world)
    camera = _film_camera(
        shown, [movable_poses(shot.world) for shot in shots], azimuth_rad, elevation_rad
    )
    colours = colours_of(shown)
    for shot in shots:
        poses = movable_poses(shot.world)
        yield png_picture.draw_png(
            camera,
            triangles_in_world(shown, poses),
            colours,
            picture_notes_of(camera, shown, poses),
        )


def _film_camera(
    shown: Sequence[PictureSurface], poses: Sequence[Floats], azimuth: float, elevation: float
) -> PictureCamera:
    corners = [triangles_in_world(shown, pose).reshape(-1, 3) for pose in poses]
    boxes = np.array(
        [(body_corners.min(axis=0), body_corners.max(axis=0)) for body_corners in corners]
    )
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    ends = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return camera_for_points(low + ends * (high - low), FILM_SIZE, azimuth, elevation)


def movable_names(world: GeometricWorld) -> list[str]:
    """What can move, in the order of `poses_of`: the world, the carriers of the arms, and the
    bodies.
    """
    carriers = [f"carrier {n + 1}" for n in range(world.joints.count)]
    return ["cell", *carriers, *world.cell.bodies]


def movable_poses(world: GeometricWorld) -> Floats:
    """The poses (n, 4, 4) in the world of what can move."""
    carriers = carrier_poses(world.joints, world.configuration)
    bodies = [world.pose("world", name) for name in world.cell.bodies]
    return np.stack([*carriers, *bodies])


def bodies_of(world: GeometricWorld) -> list[PictureSurface]:
    """The surfaces of all links and bodies; each body is its own carrier, by its number in
    `poses_of`.
    """
    scene, poses = collision_scene_of(world), movable_poses(world)
    numbers = {name: 1 + world.joints.count + n for n, name in enumerate(world.cell.bodies)}
    moving_bodies = []
    for surface in scene_surfaces(world, scene):
        if surface.body not in numbers:
            moving_bodies.append(surface)
            continue
        own = numbers[surface.body]
        T = transforms.inverse(poses[own]) @ poses[surface.carrier]
        moving_bodies.append(
            replace(surface, carrier=own, vertices=transforms.apply(T, surface.vertices))
        )
    return moving_bodies
