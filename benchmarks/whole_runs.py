"""Runs parts of the whole measurement one after another, and keeps the result of each as soon
as it is there.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from whole_figures import Output, Part

TAIL = 12  # lines of the output that are kept of a part that failed
JUDGED = (0, 1)  # exit codes of a benchmark that has measured: all bars met, or one missed


@dataclass(frozen=True)
class Result:
    """What came of a part: its exit code, None if it was ended at its limit; its figures; why
    it failed, empty if it did not.
    """

    part: str
    version: str
    code: int | None
    seconds: float
    processor_s: float
    load: float
    figures: Mapping[str, float | None] = field(default_factory=dict)
    peers: Mapping[str, float | None] = field(default_factory=dict)
    failed: str = ""


@dataclass(frozen=True)
class Bench:
    """Where results are kept, of which sources, and in which profile."""

    folder: Path
    profile: str
    version: str
    top: Path
    python: str = sys.executable
    peers: str = ""  # the Python of an environment with other planners; empty without one
    cluster: str = ""  # the address of a cluster, for parts whose work falls into units

    def file(self, part: str) -> Path:
        """The result of a part."""
        return self.folder / self.profile / f"{part}.result.json"

    def known(self, part: str) -> Result | None:
        """The result that is kept of a part, if it is one of these sources."""
        try:
            found = Result(**json.loads(self.file(part).read_text("utf-8")))
        except (OSError, ValueError, TypeError):
            return None
        return found if found.version == self.version else None

    def begin(self) -> None:
        """Forget what is kept of other sources: neither their results nor what their parts have
        tried counts here.
        """
        folder = self.folder / self.profile
        note = folder / "version"
        if folder.is_dir() and (not note.is_file() or note.read_text("utf-8") != self.version):
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        note.write_text(self.version, "utf-8")

    def keep(self, result: Result) -> None:
        """Keep a result: whole, or not at all."""
        file = self.file(result.part)
        file.parent.mkdir(parents=True, exist_ok=True)
        fresh = file.with_suffix(".new")
        fresh.write_text(json.dumps(asdict(result), indent=1) + "\n", "utf-8")
        fresh.replace(file)


def run_all(
    bench: Bench, parts: Sequence[Part], minutes: float, tell: Callable[[str], None] = print
) -> list[Result]:
    """The results of all parts of the profile, those that are kept first. Stops beginning parts
    when the minutes are over.

    Raises `KeyboardInterrupt` after the part that it interrupts has ended; what is finished stays
    kept.
    """
    bench.begin()
    chosen = [part for part in parts if part.arguments(bench.profile) is not None]
    ends, found = time.monotonic() + 60.0 * minutes, []
    for number, part in enumerate(chosen, 1):
        if (known := bench.known(part.name)) is not None:
            found.append(known)
            continue
        left = ends - time.monotonic()
        if left <= 0:
            tell(f"{part.name} is left out: the {minutes:g} minutes are over")
            continue
        tell(f"{number} of {len(chosen)}: {part.name}")
        result = run(bench, part, min(left, part.limit_s(bench.profile) * busy()))
        bench.keep(result)
        found.append(result)
        tell(
            f"    {result.seconds:.0f} "
            f"s{': ' + result.failed.splitlines()[0] if result.failed else ''}"
        )
    return found


def busy() -> float:
    """How many times longer a part may take because others work on this machine, too: 1 on an
    idle one.
    """
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def run(bench: Bench, part: Part, limit_s: float) -> Result:
    """Run one part in a process of its own, and read its figures."""
    folder = bench.folder / bench.profile
    folder.mkdir(parents=True, exist_ok=True)
    kept, log = folder / f"{part.name}.json", folder / f"{part.name}.txt"
    words = _words(
        part.arguments(bench.profile) or (),
        {"json": str(kept), "peers": bench.peers, "cluster": bench.cluster},
    )
    load, began = os.getloadavg()[0], time.monotonic()
    code, spent = _carried_out([bench.python, part.script, *words], bench.top, log, limit_s)
    text = log.read_text("utf-8", errors="replace")
    output = Output(_content(kept), text)
    figures = {each.what: _read(each.read, output) for each in part.figures}
    peers = {
        each.what: _read(each.peer[1], output) for each in part.figures if each.peer is not None
    }
    seconds = time.monotonic() - began
    failed = _failure(
        code, text, limit_s, part.figures and not any(v is not None for v in figures.values())
    )
    return Result(part.name, bench.version, code, seconds, spent, load, figures, peers, failed)


def _words(arguments: Sequence[str], places: Mapping[str, str]) -> list[str]:
    """The arguments with the places in them; one that asks for a place that is not there is
    left out.
    """
    return [
        each.format(**places)
        for each in arguments
        if all(places[name] for name in places if f"{{{name}}}" in each)
    ]


def _carried_out(
    words: Sequence[str], top: Path, log: Path, limit_s: float
) -> tuple[int | None, float]:
    """The exit code (None at the limit) and the seconds of the processor of a command and those
    that it starts.
    """
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(top), os.environ.get("PYTHONPATH", "")]),
    }
    before = os.times()
    with log.open("wb") as out:
        process = subprocess.Popen(
            words,
            cwd=top,
            stdout=out,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        try:
            code: int | None = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            with suppress(ProcessLookupError):  # what it has started and left behind ends with it
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    after = os.times()
    return (
        code,
        after.children_user + after.children_system - before.children_user - before.children_system,
    )


def _content(kept: Path) -> object:
    try:
        found: object = json.loads(kept.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return found


def _read(read: Callable[[Output], float | None], output: Output) -> float | None:
    """A figure; None if the benchmark has not told it, as when a peer or a data set is missing."""
    try:
        return read(output)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, ZeroDivisionError):
        return None


def _failure(code: int | None, text: str, limit_s: float, nothing: object) -> str:
    """Why there is no answer to be trusted; empty if there is one."""
    tail = "\n".join(text.splitlines()[-TAIL:])
    if code is None:
        return f"ended after {limit_s:.0f} s\n{tail}"
    if code not in JUDGED or "Traceback (most recent call last)" in text:
        return f"failed with exit code {code}\n{tail}"
    return f"it told none of its figures\n{tail}" if nothing else ""
