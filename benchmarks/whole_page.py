"""The page of the whole measurement: every figure with its bar, its peer and the last time;
what regressed, failed or is missing.
"""

import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from whole_figures import Figure, Part
from whole_runs import Result

PEERS = {
    "OR-Tools": "ortools", "MuJoCo": "mujoco", "coal": "coal", "EAIK": "eaik", "CoACD": "coacd", "OMPL": "ompl",
    "unified-planning": "unified-planning", "Open3D": "open3d", "scikit-image": "scikit-image",
}  # fmt: skip
# in an environment of their own
BESIDE = ("up-fast-downward", "pyperplan", "up-enhsp", "cosmic-ray")
GIB = 2**30


@dataclass(frozen=True)
class Machine:
    """The kind of a machine. It tells no names."""

    cores: int
    processor: str
    memory_gb: int
    system: str
    python: str


def this_machine() -> Machine:
    """What this machine is like."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    return Machine(
        cores, _processor(), round(memory / GIB), platform.system(), platform.python_version()
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def peers(beside: Path) -> dict[str, str]:
    """The peers with their versions, `not installed` for those that are not there; `beside` is
    the folder of others.
    """
    found = {}
    for name, package in PEERS.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            found[name] = "not installed"
    for name in BESIDE:
        folders = sorted(beside.glob(f"lib/*/site-packages/{name.replace('-', '_')}-*.dist-info"))
        found[name] = (
            folders[-1].name.split("-")[1].removesuffix(".dist") if folders else "not installed"
        )
    return found


@dataclass(frozen=True)
class Measured:
    """A whole measurement: when, on what kind of machine, beside which peers, and what came of
    each part.
    """

    date: str
    profile: str
    version: str
    machine: Machine
    peers: Mapping[str, str]
    results: tuple[Result, ...]

    def document(self) -> dict[str, Any]:
        """The measurement as data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> "Measured":
        """The measurement from such data.

        Raises `TypeError`, `KeyError` if it is something else.
        """
        results = tuple(Result(**each) for each in document["results"])
        return cls(**{**document, "machine": Machine(**document["machine"]), "results": results})

    def value(self, figure: Figure) -> float | None:
        """The value of a figure; None if it was not measured."""
        return next(
            (r.figures[figure.what] for r in self.results if figure.what in r.figures), None
        )

    def failed(self) -> dict[str, str]:
        """The parts that failed, and why."""
        return {each.part: each.failed for each in self.results if each.failed}


def regressed(now: Measured, before: Measured | None, parts: Sequence[Part]) -> Iterator[str]:
    """What is worse than the last time, beyond the noise of each figure; and parts that fail and
    did not.

    On another kind of machine only figures without noise are compared.
    """
    if before is None:
        return
    for name in now.failed():
        if name not in before.failed() and any(each.part == name for each in before.results):
            yield f"{name} fails; it did not the last time"
    alike = now.machine == before.machine
    for figure in (figure for part in parts for figure in part.figures):
        value, old = now.value(figure), before.value(figure)
        if value is None or old is None or not (alike or figure.noise == 0.0):
            continue
        if figure.worse(value, old):
            bar = (
                " and misses its bar now" if figure.met(value) is False and figure.met(old) else ""
            )
            yield f"{figure.what}: {told(value, figure)}, it was {number(old)}{bar}"


def missed(now: Measured, parts: Sequence[Part]) -> list[str]:
    """The bars that are missed."""
    return [
        f"{figure.what}: {told(value, figure)}, the bar is {number(figure.bar)}"
        for figure in (figure for part in parts for figure in part.figures)
        if (value := now.value(figure)) is not None
        and figure.met(value) is False
        and figure.bar is not None
    ]


def number(value: float) -> str:
    """A number as people read it: three digits, or all of a whole number."""
    if value == int(value) and abs(value) < 1e9:
        return f"{int(value):,}"
    return f"{value:.3g}"


def told(value: float, figure: Figure) -> str:
    """A value with its unit."""
    return f"{number(value)} {figure.unit}".strip()


def page(now: Measured, before: Measured | None, parts: Sequence[Part]) -> str:
    """The page in Markdown."""
    return (
        "\n".join(
            [
                *_head(now, before),
                *_found(now, before, parts),
                *_figures(now, before, parts),
                *_end(now),
            ]
        )
        + "\n"
    )


def _head(now: Measured, before: Measured | None) -> Iterator[str]:
    m, minutes = now.machine, sum(each.seconds for each in now.results) / 60
    loads = [each.load for each in now.results] or [0.0]
    yield f"# Figures, {now.profile} profile, {now.date}"
    yield ""
    yield f"{m.cores} cores of {m.processor}, {m.memory_gb} GB, {m.system}, Python {m.python}."
    yield (
        f"{len(now.results)} parts in {minutes:.0f} minutes; load before the parts "
        f"{min(loads):.1f} to {max(loads):.1f}"
    )
    yield (
        "(what the parts left behind counts; far above the number of cores, times of the clock "
        "say little)."
    )
    compared = (
        "There is no page to compare with." if before is None else f"Compared with {before.date}"
    )
    if before is not None:
        compared += (
            "."
            if before.machine == now.machine
            else " on another kind of machine: only figures without noise are compared."
        )
    yield (
        f"{compared} A time is worse if it is longer by more than a quarter, unless its line "
        "says another share."
    )


def _found(now: Measured, before: Measured | None, parts: Sequence[Part]) -> Iterator[str]:
    run = {each.part for each in now.results}
    left = [
        each.name
        for each in parts
        if each.arguments(now.profile) is not None and each.name not in run
    ]
    sections = {
        "Regressed": list(regressed(now, before, parts)),
        "Bars missed": missed(now, parts),
        "Failed": [f"{name}: {why.splitlines()[0]}" for name, why in now.failed().items()],
        "Not run": left,
    }
    for title, lines in sections.items():
        yield from ("", f"## {title}", "", *([f"- {each}" for each in lines] or ["Nothing."]))


def _figures(now: Measured, before: Measured | None, parts: Sequence[Part]) -> Iterator[str]:
    issues = sorted({figure.issue for part in parts for figure in part.figures})
    for issue in issues:
        yield from ("", f"## Issue {issue}", "")
        yield "| figure | value | bar | met | last time | noise | peer | part |"
        yield "| --- | --: | --: | --- | --: | --: | --- | --- |"
        for part in parts:
            for figure in part.figures:
                if figure.issue == issue:
                    yield _row(now, before, part, figure)


def _row(now: Measured, before: Measured | None, part: Part, figure: Figure) -> str:
    value, old = now.value(figure), before.value(figure) if before else None
    sign = "at most" if figure.less else "at least"
    bar = "" if figure.bar is None else f"{sign} {number(figure.bar)}"
    met = {None: "", True: "yes", False: "**no**"}[figure.met(value)]
    own = next((each for each in now.results if each.part == part.name), None)
    beside = ""
    if figure.peer is not None:
        theirs = own.peers.get(figure.what) if own else None
        beside = f"{figure.peer[0]}: {'not measured' if theirs is None else number(theirs)}"
    shown = "not measured" if value is None else told(value, figure)
    cells = (
        figure.what,
        shown,
        bar,
        met,
        "" if old is None else number(old),
        f"{figure.noise:.0%}",
        beside,
        part.name,
    )
    return f"| {' | '.join(cells)} |"


def _end(now: Measured) -> Iterator[str]:
    yield from ("", "## Peers", "", "| peer | version |", "| --- | --- |")
    yield from (f"| {name} | {found} |" for name, found in now.peers.items())
    yield from (
        "",
        "## Parts",
        "",
        "| part | minutes | minutes of the processor | load before | came out |",
    )
    yield "| --- | --: | --: | --: | --- |"
    for each in now.results:
        came = (
            each.failed.splitlines()[0]
            if each.failed
            else {0: "all bars of its own met"}.get(each.code or 0, "misses a bar of its own")
        )
        yield (
            f"| {each.part} | {each.seconds / 60:.1f} | {each.processor_s / 60:.1f} | "
            f"{each.load:.1f} | {came} |"
        )
    for name, why in now.failed().items():
        yield from ("", f"### {name}", "", "```", *why.splitlines()[1:], "```")
