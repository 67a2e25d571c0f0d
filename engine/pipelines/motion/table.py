"""A table of travel times between the places of a cell, as facts that a domain's `travel` takes."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.pipelines.motion.ends import arm_named, tool_of
from cellwright.engine.pipelines.motion.moving import Site
from cellwright.engine.pipelines.motion.stations import (
    Stations,
    all_pairs,
    all_travels,
    lines_of,
    near_one_another,
    stations,
)
from cellwright.engine.stages.motion.roadmap import Roadmap
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Times (n, n) in s between places; infinite where no path was found. `least_s` is what no path beats.

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


def sought(
    site: Site, tool: str, wanted: Collection[str] = ()
) -> tuple[Stations, Longs, str, dict[str, str]]:
    """The stations of a table, all pairs of them, the tool, and the places out of reach. Raises `InvalidInput`."""
    cell = site.world.cell
    tool, arm = tool_of(tool, cell), arm_named("", cell, "TARGET")
    for name in wanted:
        if name not in cell.places:
            raise InvalidInput([unknown_name("place", name, cell.places, Source("--place"))])
    places = {
        name: place
        for name, place in cell.places.items()
        if place.tool == tool and place.arm == arm and (not wanted or name in wanted)
    }
    reached, unreached = near_one_another(site.reach, site.world, places)
    if len(reached) < 2:
        said = f"the arm reaches {len(reached)} places with {tool or 'no tool'} in hand"
        raise InvalidInput([Diagnostic(Source("--tool"), "K705", said, "name the tool of more places")])
    own = {name: places[name] for name in reached}
    found = stations(site.world, site.reach, arm, own, list(reached.values()))
    return found, all_pairs(found), tool, {**unreached, **found.unreached}


def table(
    site: Site,
    tool: str,
    wanted: Collection[str] = (),
    proved: Callable[[Stations, Longs], Roadmap] = lines_of,
) -> Table:
    """The travel times between places for one tool, out of a place, on a free path, and into the next.

    `proved` makes the roadmap of all pairs (p, 2) of stations. Raises `InvalidInput`.
    """
    found, pairs, tool, unreached = sought(site, tool, wanted)
    ways, least = all_travels(found, proved(found, pairs)), found.least()
    times = np.zeros_like(least)
    a, b = ways.pairs[:, 0], ways.pairs[:, 1]
    times[a, b] = times[b, a] = ways.time_s
    ends = found.outs_s[:, None] + found.outs_s[None]
    return Table(tool, found.names, times + ends, least + ends, ways.planned, unreached)
