"""Measurements grouped by tool, for people and programs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.tour import PoseProblem, Tour


class Parts(Protocol):
    """The measurements by tool, those that are done, and those that are impossible, with the reasons."""

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]: ...
    @property
    def done(self) -> tuple[str, ...]: ...
    @property
    def impossible(self) -> Mapping[str, str]: ...


class Posed(Protocol):
    """A closed tour of one tool by one arm, with a configuration at each visit."""

    @property
    def tool(self) -> str: ...
    @property
    def arm(self) -> str: ...
    @property
    def problem(self) -> PoseProblem: ...
    @property
    def tour(self) -> Tour: ...
    @property
    def configurations(self) -> NDArray[np.float64]: ...


def posed_entry(found: Posed) -> dict[str, Any]:
    """A tour through configurations, for JSON. Joint values are in radians and metres."""
    return {
        "tool": found.tool,
        "arm": found.arm,
        "visits": [found.problem.visits[each].name for each in found.tour.order],
        "configurations": np.round(found.configurations, 6).tolist(),
        "cost": found.tour.cost,
        "unit": "µs",
        "method": found.tour.method,
        "work": found.tour.work,
    }


class Driven(Protocol):
    """A closed tour of one tool by one arm, with the time of each move."""

    @property
    def posed(self) -> Posed: ...
    @property
    def visits(self) -> tuple[str, ...]: ...
    @property
    def moves_s(self) -> tuple[float, ...]: ...
    @property
    def bound_s(self) -> float: ...
    @property
    def planned(self) -> int: ...
    @property
    def unreached(self) -> Mapping[str, str]: ...
    @property
    def time_s(self) -> float: ...


def driven_entry(found: Driven) -> dict[str, Any]:
    """A tour by the times of free paths, for JSON, in seconds; each move leads from its visit to the next one."""
    return {
        "tool": found.posed.tool,
        "arm": found.posed.arm,
        "visits": list(found.visits),
        "moves_s": [round(each, 6) for each in found.moves_s],
        "time_s": found.time_s,
        "least_s": found.bound_s,
        "planned": found.planned,
        "unreached": dict(found.unreached),
    }


def driven(tours: Sequence[Driven], partition: Parts) -> RenderableType:
    """The tours by tool, how long they take, and by how much the times of their moves may be too long."""
    rows = [
        (each.posed.tool, each.posed.arm, f"{each.time_s:.2f}", f"{each.bound_s:.2f}", ", ".join(each.visits))
        for each in tours
    ]
    left_out = [Text(f"{name} is left out: {why}") for each in tours for name, why in each.unreached.items()]
    table = TextTable(("tool", "arm", "s", "at least", "in order"), rows)
    said = Text("The times are those of free paths; no path takes less than 'at least' in this order.")
    return Group(parts(partition), table, said, *left_out)


def posed(tours: Sequence[Posed], partition: Parts) -> RenderableType:
    """The tours by tool with their durations, and the measurements that are impossible."""
    rows = []
    for each in tours:
        names = ", ".join(each.problem.visits[visit].name for visit in each.tour.order)
        rows.append((each.tool, each.arm, f"{each.tour.cost / 1e6:.2f}", names))
    return Group(parts(partition), TextTable(("tool", "arm", "s", "in order"), rows))


def entry(partition: Parts) -> dict[str, Any]:
    """The groups of measurements, for JSON. Every measurement is in one group."""
    return {
        "groups": {tool: list(names) for tool, names in partition.groups.items()},
        "done": list(partition.done),
        "impossible": dict(partition.impossible),
    }


def parts(partition: Parts, title: str = "") -> RenderableType:
    """The number of measurements by each tool, and the number of impossible ones for each reason."""
    rows = [(str(len(names)), tool) for tool, names in partition.groups.items()]
    rows += [(str(len(partition.done)), "done")] if partition.done else []
    impossible = sorted(Counter(partition.impossible.values()).items())
    rows += [(str(count), f"impossible: {reason}") for reason, count in impossible]
    table = TextTable(("measurements", "by"), rows, right=("measurements",))
    return Group(Text(title), table) if title else table
