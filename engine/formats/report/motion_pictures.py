"""Pictures of a motion: joint values over time, the cell with the way of the hand, and a scene that moves."""

from dataclasses import replace

import numpy as np

from cellwright.engine.formats.report import motion_svg
from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.model.motion import Blocked, Moved
from cellwright.engine.pipelines.motion.moving import Motion
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.pictures import gltf, png
from cellwright.engine.stages.geometry.pictures.camera import colours_of, looking_at, triangles_in_world
from cellwright.engine.stages.geometry.pictures.notes import notes_of
from cellwright.engine.stages.geometry.pictures.surfaces import Surface, surfaces

SIZE = (960, 720)
MARK_M, MARKS = 0.008, 120  # size and number of the marks on the way of the hand
WAY = (0.55, 0.15, 0.55)
PALER = 0.45  # how much of its colour the arm has where it starts
FRAME_S = 0.04  # between two pictures of a scene that moves
CORNERS = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=float)
FACES = np.array([(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)], dtype=np.int64)


def as_svg(motion: Motion) -> str:
    """Joint values and speeds over time."""
    moments = np.linspace(0.0, motion.times.duration_s, motion_svg.MOMENTS)
    values, speeds, _ = motion.times.at(moments)
    return motion_svg.picture(motion.joints, moments, values, speeds)


def as_gltf(motion: Motion) -> str:
    """The cell, with the arm moving as the trajectory says."""
    count = int(np.ceil(motion.times.duration_s / FRAME_S)) + 1  # one moment, where nothing moves
    moments = np.linspace(0.0, motion.times.duration_s, count)
    whole = np.repeat(motion.whole()[:1], count, axis=0)
    whole[:, motion.own] = motion.times.at(moments)[0]
    scene = motion.ground.scene
    return gltf.document(surfaces(motion.world, scene), scene.joints, moments, whole)


def as_png(motion: Motion, azimuth_rad: float, elevation_rad: float) -> bytes:
    """The cell with the arm at both ends of the path, the start paler, and marks where the hand passes.

    Without a path: the arm where it starts, or where the way is blocked worst, with what touches there. If it is proved that
    there is none: the arm, beside its start, at what cuts the goal off.
    """
    scene, answer = motion.ground.scene, motion.answer
    ends, contacts = _shown(motion)
    shown = surfaces(motion.world, scene, contacts)
    carriers = carrier_poses(scene.joints, ends)
    marks = _marks(motion) if isinstance(answer, Moved) else []
    pale = [replace(each, colour=_paler(each)) for each in shown if each.carrier > 0 and len(ends) > 1]
    drawn = [triangles_in_world([*shown, *marks], carriers[-1]), triangles_in_world(pale, carriers[0])]
    triangles = np.concatenate(drawn)
    camera = looking_at(triangles.reshape(-1, 3), SIZE, azimuth_rad, elevation_rad)
    colours = colours_of([*shown, *marks, *pale])
    return png.draw(camera, triangles, colours, notes_of(camera, shown, carriers[-1], contacts))


def _shown(motion: Motion) -> tuple[Floats, tuple[Contact, ...]]:
    """The configurations (n, k) that are drawn, and what touches at the last one."""
    answer = motion.answer
    if isinstance(answer, Moved):
        return motion.whole()[[0, -1]], ()
    if isinstance(answer, Blocked) and answer.severed is not None:
        return np.stack([motion.start, answer.severed.at]), answer.severed.contacts
    ends = answer.at[None] if isinstance(answer, Blocked) else np.array([motion.start])
    return ends, motion.ground.contacts(ends[-1])


def _paler(surface: Surface) -> tuple[float, float, float]:
    red, green, blue = (1.0 - PALER * (1.0 - part) for part in surface.colour)
    return red, green, blue


def _marks(motion: Motion) -> list[Surface]:
    """Small octahedra where the hand passes, at even times."""
    moments = np.linspace(0.0, motion.times.duration_s, MARKS)
    whole = np.repeat(motion.whole()[:1], MARKS, axis=0)
    whole[:, motion.own] = motion.times.at(moments)[0]
    points: Floats = motion.hand.poses(whole)[:, :3, 3]
    return [Surface("way", 0, point + MARK_M * CORNERS, FACES, WAY, "region") for point in points]
