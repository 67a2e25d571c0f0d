"""What a part of the whole measurement is, and how its figures are read from what a benchmark
leaves behind.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

NOISE = 0.25  # the share by which a time may differ from run to run on an idle machine
EXACT = 0.0  # for counts and shares that a seed decides


@dataclass(frozen=True)
class Output:
    """What a benchmark left: the JSON that it kept (None if none), and what it printed."""

    kept: Any
    text: str


Read = Callable[[Output], float | None]


@dataclass(frozen=True)
class Figure:
    """A figure that an issue named. With a `bar` it has to be at most that, or at least that if
    more is better.

    `noise` is the share by which it may be worse than the last time. `peer` names another program,
    and reads its figure from the same run.
    """

    issue: int
    what: str
    read: Read
    unit: str = ""
    bar: float | None = None
    less: bool = True
    noise: float = NOISE
    peer: tuple[str, Read] | None = None

    def met(self, value: float | None) -> bool | None:
        """Whether the bar is met; None if there is no bar or no value."""
        if self.bar is None or value is None:
            return None
        return value <= self.bar if self.less else value >= self.bar

    def worse(self, value: float, before: float) -> bool:
        """Whether the value is worse than the one before, by more than the noise."""
        slack = self.noise * abs(before) + 1e-9
        return value > before + slack if self.less else value < before - slack


@dataclass(frozen=True)
class Part:
    """A benchmark with its arguments in both profiles; `{json}` stands for the file that it keeps,
    `{cluster}` for the address of a cluster.

    A profile whose arguments are None leaves it out. `minutes` are what it may take in each profile
    before it is ended.
    """

    name: str
    script: str
    quick: tuple[str, ...] | None
    full: tuple[str, ...] | None
    figures: tuple[Figure, ...] = ()
    minutes: tuple[float, float] = (5.0, 60.0)
    peers: tuple[str, ...] = field(default=())

    def arguments(self, profile: str) -> tuple[str, ...] | None:
        """The arguments in a profile; None if it is left out."""
        return self.quick if profile == "quick" else self.full

    def limit_s(self, profile: str) -> float:
        """The seconds after which it is ended."""
        return 60.0 * self.minutes[0 if profile == "quick" else 1]


def at(*keys: str | int) -> Read:
    """The number at this place of the JSON."""

    def read(output: Output) -> float | None:
        found = output.kept
        for key in keys:
            found = found[key]
        return float(found)

    return read


def of(
    rows: Callable[[Any], Iterable[Any]], key: str, how: Callable[[Sequence[float]], float] = max
) -> Read:
    """One number of all those under a key of some rows: the largest, if nothing else is said.

    None without rows.
    """

    def read(output: Output) -> float | None:
        values = [float(row[key]) for row in rows(output.kept) if row.get(key) is not None]
        return how(values) if values else None

    return read


def every(kept: Any) -> Iterable[Any]:
    """All rows."""
    rows: Iterable[Any] = kept
    return rows


def where(key: str, value: Any, inside: str = "") -> Callable[[Any], Iterable[Any]]:
    """The rows (those under `inside`) with this value under a key; a text has to occur in the
    row's text.
    """

    def rows(kept: Any) -> Iterable[Any]:
        found = kept[inside] if inside else kept
        return [
            row
            for row in found
            if (value in row[key] if isinstance(value, str) else row[key] == value)
        ]

    return rows


def share(condition: Callable[[Any], bool], rows: Callable[[Any], Iterable[Any]] = every) -> Read:
    """The share of rows that meet a condition, in per cent."""

    def read(output: Output) -> float | None:
        found = [condition(row) for row in rows(output.kept)]
        return 100.0 * sum(found) / len(found) if found else None

    return read


def counted(condition: Callable[[Any], bool], rows: Callable[[Any], Iterable[Any]] = every) -> Read:
    """How many rows meet a condition."""
    return lambda output: float(sum(condition(row) for row in rows(output.kept)))


def said(pattern: str) -> Read:
    """The last number that the output shows in this form; the pattern has one group."""
    import re

    def read(output: Output) -> float | None:
        found = re.findall(pattern, output.text)
        return float(found[-1].replace(",", "")) if found else None

    return read


def quantile(q: float) -> Callable[[Sequence[float]], float]:
    """A quantile of numbers: the value that a share of `q` does not exceed."""
    return lambda values: sorted(values)[min(len(values) - 1, math.ceil(q * len(values)) - 1)]


median = statistics.median
mean = statistics.fmean
