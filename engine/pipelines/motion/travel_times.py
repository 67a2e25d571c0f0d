"""Travel times between places: stations with straight lines out, and the table of all pairs."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.pipelines.motion.arm_motion import MotionSite, limits_of
from cellwright.engine.pipelines.motion.motion_legs import arm_named, tool_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.geometry.reach.arm_hand import ArmHand, BrokenLine, straight_line
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.roadmap import Roadmap, TravelTimes, map_nodes, travel_times
from cellwright.engine.stages.motion.timed_paths import JointLimits, least_times, smooth_path
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.cell_model import Place


@dataclass(frozen=True, slots=True, eq=False)
class TravelStations:
    """Where the free ways between visits begin and end: configurations (n, k), and the times (n,)
    of the lines out of the visits.

    `unreached` are the visits that are left out, with the reason.
    """

    names: tuple[str, ...]
    nodes: Floats
    outs_s: Floats
    ground: PlanningScene
    hand: ArmHand
    limits: JointLimits
    unreached: Mapping[str, str]

    def least(self) -> Floats:
        """The least times (n, n) that any path between two stations takes, without the lines
        out and in.
        """
        own, count = self.nodes[:, self.hand.own], len(self.nodes)
        rows = [
            least_times(np.repeat(own[n : n + 1], count, axis=0), own, self.limits)
            for n in range(count)
        ]
        return np.array(rows).reshape(count, count)


def travel_stations(
    world: GeometricWorld,
    reach: PlaceReachability,
    arm: str,
    places: Mapping[str, Place | None],
    own: Sequence[Floats],
) -> TravelStations:
    """The stations of one arm at its own configurations (k,); a visit without a place is where the
    arm rests.

    All places take the same tool.
    """
    first_place = next((place for place in places.values() if place is not None), None)
    assert first_place is not None
    still, limits = replace(first_place, touches=()), limits_of(world, arm)
    ground = PlanningScene(reach.checker(still))
    hand = ArmHand(world, ground.scene, arm, reach.flange_to_end(still))
    lines, unreached = {}, {}
    for (name, place), q in zip(places.items(), reach.whole(still, np.array(own)), strict=True):
        line = _line_out(hand, q, place.approach_m if place else 0.0)
        if isinstance(line, BrokenLine):
            unreached[name] = line.why
        else:
            lines[name] = line
    nodes = np.array([line[-1] for line in lines.values()]).reshape(-1, world.joints.count)
    hits = ground.collides(nodes)
    for name, q in zip(np.array(list(lines), dtype=object)[hits], nodes[hits], strict=True):
        unreached[name] = _touch_text(ground, q)
    free = [name for name in lines if name not in unreached]
    outs = np.array([_line_duration_s(lines[name][:, hand.own], limits) for name in free])
    return TravelStations(tuple(free), nodes[~hits], outs, ground, hand, limits, unreached)


def _line_duration_s(line: Floats, limits: JointLimits) -> float:
    """How long (s) a straight line (m, k) out of a visit takes, from rest to rest."""
    even = np.zeros(len(line)), np.ones(len(line) - 1)
    return smooth_path(line, limits, *even).duration_s if len(line) > 1 else 0.0


def _touch_text(ground: PlanningScene, q: Floats) -> str:
    """What touches at a configuration (k,) that is not free."""
    touches_text = [
        f"{contact.first} overlaps {contact.second} by {contact.depth_m * 1000:.0f} mm"
        for contact in ground.contacts(q)
    ]
    return (
        f"with the tool in hand, {touches_text[0]}"
        if touches_text
        else "with the tool in hand, something touches"
    )


def _line_out(hand: ArmHand, q: Floats, approach_m: float) -> Floats | BrokenLine:
    """The straight line out of a visit; where there is no approach, only where it is."""
    if approach_m == 0.0:
        return q[None]
    return straight_line(
        hand, q, matmul(hand.poses(q[None])[0], transforms.translation(0.0, 0.0, -approach_m))
    )


def near_one_another(
    reach: PlaceReachability, world: GeometricWorld, places: Mapping[str, Place]
) -> tuple[dict[str, Floats], dict[str, str]]:
    """For each place one configuration, all near one another; and the places that are not reached,
    with the reason.

    Of the configurations of the first place, that one counts from which all places are reached
    soonest, in all.
    """
    choices: dict[str, Floats] = {}
    unreached: dict[str, str] = {}
    for name, place in places.items():
        answer = reach.at(place)
        if isinstance(answer, UnreachedPlace):
            unreached[name] = answer.reason
        else:
            choices[name] = answer.q / limits_of(world, place.arm).speed
    if not choices:
        return {}, unreached
    middles = next(iter(choices.values()))
    away = [
        np.abs(middles[:, None] - options[None]).max(axis=2).min(axis=1)
        for options in choices.values()
    ]
    middle = middles[int(np.argmin(np.sum(away, axis=0)))]
    return {
        name: options[int(np.argmin(np.abs(options - middle).max(axis=1)))]
        * limits_of(world, places[name].arm).speed
        for name, options in choices.items()
    }, unreached


def all_pairs(ends: TravelStations) -> Longs:
    """All pairs (p, 2) of stations, the lesser number first."""
    pairs: Longs = np.stack(np.triu_indices(len(ends.nodes), 1), axis=1).astype(np.int64)
    return pairs


def lines_of(ends: TravelStations, pairs: Longs) -> Roadmap:
    """The roadmap of straight lines between pairs (p, 2) of stations."""
    return map_nodes(ends.ground, ends.nodes, pairs)


def all_travels(ends: TravelStations, roadmap: Roadmap) -> TravelTimes:
    """The times of the free ways between all pairs of stations that the roadmap joins."""
    return travel_times(ends.ground, roadmap, roadmap.edges, ends.limits, ends.hand.own)[0]


@dataclass(frozen=True, slots=True, eq=False)
class TravelTable:
    """Times (n, n) in s between places; infinite where no path was found. `least_s` is what no path
    beats.

    `unreached` are left out, with the reason; `planned` ways had to be planned for one by one.
    """

    tool: str
    names: tuple[str, ...]
    times_s: Floats
    least_s: Floats
    planned: int
    unreached: dict[str, str]

    def facts(self, unit_s: float) -> list[str]:
        """The facts `travel(from, to, time)`, rounded up to whole units of time."""
        return [
            f"travel({a}, {b}, {math.ceil(self.times_s[i, j] / unit_s - 1e-9)})"
            for i, a in enumerate(self.names)
            for j, b in enumerate(self.names)
            if i != j and np.isfinite(self.times_s[i, j])
        ]


def table_stations(
    site: MotionSite, tool: str, wanted_places: Collection[str] = ()
) -> tuple[TravelStations, Longs, str, dict[str, str]]:
    """The stations of a table, all pairs of them, the tool, and the places out of reach.

    Raises `InvalidInput`.
    """
    cell = site.world.cell
    tool, arm = tool_of(tool, cell), arm_named("", cell, "TARGET")
    for name in wanted_places:
        if name not in cell.places:
            raise InvalidInput([unknown_name("place", name, cell.places, Source("--place"))])
    places = {
        name: place
        for name, place in cell.places.items()
        if place.tool == tool and place.arm == arm and (not wanted_places or name in wanted_places)
    }
    reached, unreached = near_one_another(site.reach, site.world, places)
    if len(reached) < 2:
        message = f"the arm reaches {len(reached)} places with {tool or 'no tool'} in hand"
        raise InvalidInput(
            [Diagnostic(Source("--tool"), "K705", message, "name the tool of more places")]
        )
    own = {name: places[name] for name in reached}
    ends = travel_stations(site.world, site.reach, arm, own, list(reached.values()))
    return ends, all_pairs(ends), tool, {**unreached, **ends.unreached}


def make_travel_table(
    site: MotionSite,
    tool: str,
    wanted_places: Collection[str] = (),
    proved: Callable[[TravelStations, Longs], Roadmap] = lines_of,
) -> TravelTable:
    """The travel times between places for one tool, out of a place, on a free path, and into the
    next.

    `proved` makes the roadmap of all pairs (p, 2) of stations. Raises `InvalidInput`.
    """
    table_ends, pairs, tool, unreached = table_stations(site, tool, wanted_places)
    ways, least = all_travels(table_ends, proved(table_ends, pairs)), table_ends.least()
    times = np.zeros_like(least)
    a, b = ways.pairs[:, 0], ways.pairs[:, 1]
    times[a, b] = times[b, a] = ways.time_s
    ends = table_ends.outs_s[:, None] + table_ends.outs_s[None]
    return TravelTable(tool, table_ends.names, times + ends, least + ends, ways.planned, unreached)
