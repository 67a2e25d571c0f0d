"""Measurements and tours by tool, with those that are impossible and why, as text and data."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.tour_problem import PoseProblem, Tour


class ToolGroups(Protocol):
    """The measurements by tool, those that are done, and those that are impossible, with the
    reasons.
    """

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]: ...
    @property
    def done(self) -> tuple[str, ...]: ...
    @property
    def impossible(self) -> Mapping[str, str]: ...


class PosedToolTour(Protocol):
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


def posed_entry(posed_tour: PosedToolTour) -> dict[str, Any]:
    """A tour through configurations, for JSON. Joint values are in radians and metres."""
    return {
        "tool": posed_tour.tool,
        "arm": posed_tour.arm,
        "visits": [
            posed_tour.problem.visits[visit_index].name for visit_index in posed_tour.tour.order
        ],
        "configurations": np.round(posed_tour.configurations, 6).tolist(),
        "cost": posed_tour.tour.cost,
        "unit": "µs",
        "method": posed_tour.tour.method,
        "work": posed_tour.tour.work,
    }


class DrivenToolTour(Protocol):
    """A closed tour of one tool by one arm, with the time of each move."""

    @property
    def posed(self) -> PosedToolTour: ...
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


def driven_entry(driven_tour: DrivenToolTour) -> dict[str, Any]:
    """A tour by the times of free paths, for JSON, in seconds; each move leads from its visit
    to the next one.
    """
    return {
        "tool": driven_tour.posed.tool,
        "arm": driven_tour.posed.arm,
        "visits": list(driven_tour.visits),
        "moves_s": [round(move_time_s, 6) for move_time_s in driven_tour.moves_s],
        "time_s": driven_tour.time_s,
        "least_s": driven_tour.bound_s,
        "planned": driven_tour.planned,
        "unreached": dict(driven_tour.unreached),
    }


def driven_text(tours: Sequence[DrivenToolTour], partition: ToolGroups) -> RenderableType:
    """The tours by tool, how long they take, and by how much the times of their moves may be
    too long.
    """
    rows = [
        (
            tour.posed.tool,
            tour.posed.arm,
            f"{tour.time_s:.2f}",
            f"{tour.bound_s:.2f}",
            ", ".join(tour.visits),
        )
        for tour in tours
    ]
    left_out = [
        Text(f"{name} is left out: {why}") for tour in tours for name, why in tour.unreached.items()
    ]
    table = TextTable(("tool", "arm", "s", "at least", "in order"), rows)
    times_note = Text(
        "The times are those of free paths; no path takes less than 'at least' in this order."
    )
    return Group(tool_groups_text(partition), table, times_note, *left_out)


def posed_text(tours: Sequence[PosedToolTour], partition: ToolGroups) -> RenderableType:
    """The tours by tool with their durations, and the measurements that are impossible."""
    rows = []
    for tour in tours:
        names = ", ".join(tour.problem.visits[visit].name for visit in tour.tour.order)
        rows.append((tour.tool, tour.arm, f"{tour.tour.cost / 1e6:.2f}", names))
    return Group(tool_groups_text(partition), TextTable(("tool", "arm", "s", "in order"), rows))


def tool_groups_entry(partition: ToolGroups) -> dict[str, Any]:
    """The groups of measurements, for JSON. Every measurement is in one group."""
    return {
        "groups": {tool: list(names) for tool, names in partition.groups.items()},
        "done": list(partition.done),
        "impossible": dict(partition.impossible),
    }


def tool_groups_text(partition: ToolGroups, title: str = "") -> RenderableType:
    """The number of measurements by each tool, and the number of impossible ones for each
    reason.
    """
    rows = [(str(len(names)), tool) for tool, names in partition.groups.items()]
    rows += [(str(len(partition.done)), "done")] if partition.done else []
    impossible = sorted(Counter(partition.impossible.values()).items())
    rows += [(str(count), f"impossible: {reason}") for reason, count in impossible]
    table = TextTable(("measurements", "by"), rows, right=("measurements",))
    return Group(Text(title), table) if title else table
