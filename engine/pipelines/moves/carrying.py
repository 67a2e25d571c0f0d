"""Two arms carry one body: the chain of arm, body and arm stays closed, since each hand keeps its pose on the body.

The body goes up, across and down on straight lines; of several heights the least is taken on which both arms follow and nothing
touches. One arm's joints follow from the pose of the body, and so do the other's, so only the path of the body is looked for
(Han & Amato 2001: active and passive parts of a closed chain).
"""

import itertools

import numpy as np

from cellwright.engine.kernels.geometry.proof import proved
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.motion import FINEST_M
from cellwright.engine.model.moves import Leg, LegKind
from cellwright.engine.pipelines.moves.hands import CARRYING, Hands, held, limits_at
from cellwright.engine.pipelines.moves.rooms import Room, corners_within
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.world.scenes import scene_of
from cellwright.engine.stages.motion.trajectory import Limits, fastest
from cellwright.kb.model.cell import Place

LIFTS_M = (0.05, 0.1, 0.2, 0.3, 0.0)  # how far the body is lifted before it goes across
STEP_M = 0.005  # how often a pose of the body is looked at
STEP_RAD = 0.02
OPEN_M = 2e-4  # how far a hand may be from its pose on the body


def carried(hands: Hands, before: Room, after: Room, first: Place, second: Place, body: str) -> Leg | str:
    """The leg on which both arms bring a body from where it is before to where it is after; a text if there is none.

    The arms stand at their places, one with its hand at each. The leg is that of the first arm, with the other's beside it.
    """
    why = f"{first.arm} and {second.arm} cannot carry {body} all the way"
    start, end = before.world.pose("world", body), after.world.pose("world", body)
    for lift in LIFTS_M:
        T = body_path(start, end, lift)
        paths = _followed(before, (first.arm, second.arm), body, T)
        if paths is None:
            continue
        if (said := _touched(before, (first, second), body, paths)) is None:
            return _leg(hands, before, (first.arm, second.arm), body, paths)
        why = said
    return why


def body_path(start: Floats, end: Floats, lift_m: float) -> Floats:
    """Poses (m, 4, 4) of a body that goes up, across and down on straight lines, turning evenly on the way across."""
    up = transforms.translation(0.0, 0.0, lift_m)
    stops = [start, matmul(up, start), matmul(up, end), end]
    found = [start[None]]
    for a, b in itertools.pairwise(stops):
        turn = transforms.rotation_vector(matmul(a[:3, :3].T, b[:3, :3]))
        angle, way = float(np.linalg.norm(turn)), b[:3, 3] - a[:3, 3]
        count = int(np.ceil(max(float(np.linalg.norm(way)) / STEP_M, angle / STEP_RAD)))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            R = transforms.rotation(tuple(turn / angle), share * angle) if angle > 1e-9 else np.eye(3)
            found.append(transforms.transform(matmul(a[:3, :3], R), a[:3, 3] + share * way)[None])
    return np.concatenate(found)


def _followed(room: Room, arms: tuple[str, str], body: str, T_world_body: Floats) -> list[Floats] | None:
    """The configurations (m, k) of each arm at common corners of a path of the body; None if an arm cannot follow."""
    world, paths = room.world, []
    kept: Truths = np.zeros(len(T_world_body), dtype=bool)
    for arm in arms:
        T_base_world, T_body_flange = world.pose(f"{arm}.base", "world"), world.pose(body, f"{arm}.flange")
        poses = matmul(matmul(T_base_world, T_world_body), T_body_flange)[None]
        at = world.configurations[arm]
        found, follows = room.tracked(arm, poses, at[None])
        if not follows[0]:
            return None
        kept = kept | corners_within(world.models[arm], found, poses, OPEN_M / 2)[0]
        paths.append(found[0])
    return [np.ascontiguousarray(path[kept]) for path in paths]


def _touched(room: Room, places: tuple[Place, Place], body: str, paths: list[Floats]) -> str | None:
    """What is in the way of arms and body on their paths (m, k); None if they are proved to be free."""
    world = room.world.affix(body, f"{places[0].arm}.tool")
    allowed = frozenset[frozenset[str]]().union(*(room.reach.intended(place) for place in places))
    ground = Ground(room.backend.checker(scene_of(world, allowed=allowed)))
    whole = np.repeat(world.configuration[None], len(paths[0]), axis=0)
    for place, path in zip(places, paths, strict=True):
        first = world.first_carriers[place.arm]
        whole[:, first : first + path.shape[1]] = path
    hits = np.nonzero(ground.collides(whole))[0]
    if len(hits):
        contact = ground.contacts(whole[hits[0]])[0]
        return f"{contact.first} touches {contact.second} while {body} is carried"
    if proved(ground.proof(0.0, FINEST_M), np.ascontiguousarray(whole)) < len(whole) - 1:
        return f"it is not proved that {body} touches nothing while it is carried"
    return None


def _leg(hands: Hands, room: Room, arms: tuple[str, str], body: str, paths: list[Floats]) -> Leg:
    """Both arms at the same time, as fast as the slower one can."""
    limits = [limits_at(hands.cell.arms[arm].arm, CARRYING) for arm in arms]
    both = Limits(
        np.concatenate([each.speed for each in limits]),
        np.concatenate([each.acceleration for each in limits]),
        np.concatenate([each.jerk for each in limits]),
    )
    corners = fastest(np.concatenate(paths, axis=1), both).corners_s
    load = (*held(room.world, arms[0]), body)
    other = Leg(LegKind.CARRY, arms[1], paths[1], corners, True, (*held(room.world, arms[1]), body))
    return Leg(LegKind.CARRY, arms[0], paths[0], corners, True, load, (other,))
