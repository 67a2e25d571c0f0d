"""Stations: visits of an arm, each at one configuration, with the straight line out of it; travel times are counted between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.pipelines.motion.moving import limits_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.engine.stages.geometry.reach.hand import ArmHand
from cellwright.engine.stages.geometry.reach.reach import Reachability, Unreached
from cellwright.engine.stages.geometry.reach.straight import Broken, straight
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.roadmap import Roadmap, Travels, mapped, travels
from cellwright.engine.stages.motion.smoothing import smoothed
from cellwright.engine.stages.motion.trajectory import Limits, least_times
from cellwright.kb.model.cell import Place


@dataclass(frozen=True, slots=True, eq=False)
class Stations:
    """Where the free ways between visits begin and end: configurations (n, k), and the times (n,) of the lines out of the visits.

    `unreached` are the visits that are left out, with the reason.
    """

    names: tuple[str, ...]
    nodes: Floats
    outs_s: Floats
    ground: Ground
    hand: ArmHand
    limits: Limits
    unreached: Mapping[str, str]

    def least(self) -> Floats:
        """The least times (n, n) that any path between two stations takes, without the lines out and in."""
        own, count = self.nodes[:, self.hand.own], len(self.nodes)
        rows = [least_times(np.repeat(own[n : n + 1], count, axis=0), own, self.limits) for n in range(count)]
        return np.array(rows).reshape(count, count)


def stations(
    world: World, reach: Reachability, arm: str, places: Mapping[str, Place | None], own: Sequence[Floats]
) -> Stations:
    """The stations of one arm at its own configurations (k,); a visit without a place is where the arm rests.

    All places take the same tool.
    """
    held = next((place for place in places.values() if place is not None), None)
    assert held is not None
    still, limits = replace(held, touches=()), limits_of(world, arm)
    ground = Ground(reach.checker(still))
    hand = ArmHand(world, ground.scene, arm, reach.flange_to_end(still))
    lines, unreached = {}, {}
    for (name, place), q in zip(places.items(), reach.whole(still, np.array(own)), strict=True):
        line = _out(hand, q, place.approach_m if place else 0.0)
        if isinstance(line, Broken):
            unreached[name] = line.why
        else:
            lines[name] = line
    nodes = np.array([line[-1] for line in lines.values()]).reshape(-1, world.joints.count)
    hits = ground.collides(nodes)
    for name, q in zip(np.array(list(lines), dtype=object)[hits], nodes[hits], strict=True):
        unreached[name] = _touching(ground, q)
    free = [name for name in lines if name not in unreached]
    outs = np.array([_lasts(lines[name][:, hand.own], limits) for name in free])
    return Stations(tuple(free), nodes[~hits], outs, ground, hand, limits, unreached)


def _lasts(line: Floats, limits: Limits) -> float:
    """How long (s) a straight line (m, k) out of a visit takes, from rest to rest."""
    even = np.zeros(len(line)), np.ones(len(line) - 1)
    return smoothed(line, limits, *even).duration_s if len(line) > 1 else 0.0


def _touching(ground: Ground, q: Floats) -> str:
    """What touches at a configuration (k,) that is not free."""
    said = [
        f"{each.first} overlaps {each.second} by {each.depth_m * 1000:.0f} mm" for each in ground.contacts(q)
    ]
    return f"with the tool in hand, {said[0]}" if said else "with the tool in hand, something touches"


def _out(hand: ArmHand, q: Floats, approach_m: float) -> Floats | Broken:
    """The straight line out of a visit; where there is no approach, only where it is."""
    if approach_m == 0.0:
        return q[None]
    return straight(hand, q, matmul(hand.poses(q[None])[0], transforms.translation(0.0, 0.0, -approach_m)))


def near_one_another(
    reach: Reachability, world: World, places: Mapping[str, Place]
) -> tuple[dict[str, Floats], dict[str, str]]:
    """For each place one configuration, all near one another; and the places that are not reached, with the reason.

    Of the configurations of the first place, that one counts from which all places are reached soonest, in all.
    """
    choices: dict[str, Floats] = {}
    unreached: dict[str, str] = {}
    for name, place in places.items():
        answer = reach.at(place)
        if isinstance(answer, Unreached):
            unreached[name] = answer.reason
        else:
            choices[name] = answer.q / limits_of(world, place.arm).speed
    if not choices:
        return {}, unreached
    middles = next(iter(choices.values()))
    away = [np.abs(middles[:, None] - each[None]).max(axis=2).min(axis=1) for each in choices.values()]
    middle = middles[int(np.argmin(np.sum(away, axis=0)))]
    return {
        name: each[int(np.argmin(np.abs(each - middle).max(axis=1)))]
        * limits_of(world, places[name].arm).speed
        for name, each in choices.items()
    }, unreached


def all_pairs(found: Stations) -> Longs:
    """All pairs (p, 2) of stations, the lesser number first."""
    pairs: Longs = np.stack(np.triu_indices(len(found.nodes), 1), axis=1).astype(np.int64)
    return pairs


def lines_of(found: Stations, pairs: Longs) -> Roadmap:
    """The roadmap of straight lines between pairs (p, 2) of stations."""
    return mapped(found.ground, found.nodes, pairs)


def all_travels(found: Stations, roadmap: Roadmap) -> Travels:
    """The times of the free ways between all pairs of stations that the roadmap joins."""
    return travels(found.ground, roadmap, roadmap.edges, found.limits, found.hand.own)[0]
