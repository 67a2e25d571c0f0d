"""Measurements grouped by tool, for people and programs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from engine.formats.report.rows import TextTable
from engine.model.tour import PoseProblem, Tour


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
