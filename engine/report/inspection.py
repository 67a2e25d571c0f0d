"""Measurements parted by tool, for people and programs."""

from collections import Counter
from collections.abc import Mapping
from typing import Any, Protocol

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text


class Parts(Protocol):
    """The measurements by tool, those done, and those that are impossible with their reasons."""

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]: ...
    @property
    def done(self) -> tuple[str, ...]: ...
    @property
    def impossible(self) -> Mapping[str, str]: ...


def entry(partition: Parts) -> dict[str, Any]:
    """What JSON says: every measurement stands in one group."""
    return {
        "groups": {tool: list(names) for tool, names in partition.groups.items()},
        "done": list(partition.done),
        "impossible": dict(partition.impossible),
    }


def parts(partition: Parts, title: str = "") -> RenderableType:
    """How many measurements each tool takes, and how many cannot be made for which reason."""
    table = Table(box=None, pad_edge=False)
    table.add_column("measurements", justify="right")
    table.add_column("by", overflow="fold")
    for tool, names in partition.groups.items():
        table.add_row(str(len(names)), tool)
    if partition.done:
        table.add_row(str(len(partition.done)), "done")
    for reason, count in sorted(Counter(partition.impossible.values()).items()):
        table.add_row(str(count), f"impossible: {reason}")
    return Group(Text(title), table) if title else table
