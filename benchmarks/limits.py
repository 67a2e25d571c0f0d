"""Limits of time and memory asked and taken, and how soon Ctrl-C ends a command, for long work of
every verb.

    python benchmarks/limits.py [--part time memory interrupt] [--only TEXT] [--seconds N]
        [--times N] [--load N] [--seed N]
                                [--json FILE]

Each command has more to do than its limit allows, or is ended by Ctrl-C at a random moment (counted
in time of the processor), also while it starts; a run, which pauses at the end of its goal, by two.
`taken` is the time of the processor that a command and those it started take. A command may take 10
% or 0.5 s more than its time, and 10 % more than its memory; Ctrl-C ends it within a second of the
processor. What takes no longer on the wall is in time, too: several processes take more. Exit code
23 tells of a limit, 130 (or the signal itself, before a verb has begun) of Ctrl-C; 0, 1, 10, 12 and
40 an answer that came in time. No traceback, and no process may stay behind. With --load so many
busy processes run beside. With --json the rows are kept. Exits with 1 if a bar is missed.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from limits_work import COMMAND, Work, works

TICK = os.sysconf("SC_CLK_TCK")
HANGS = 150.0  # seconds after which a command is killed
IDLE = 40.0  # seconds that are waited until a command has taken so much of the processor
PRESSED = 0.1  # seconds between two Ctrl-C of a person in a hurry
ANSWERED = {0, 1, 10, 12, 40}


@dataclass(frozen=True)
class Row:
    """One command under one limit, or ended by Ctrl-C `asked` seconds after its begin."""

    part: str
    name: str
    asked: float
    taken: float
    wall: float
    megabytes: float
    code: int
    wrong: str

    def line(self) -> str:
        """The row of a table in Markdown."""
        figures = (
            f"{self.asked:.2f} | {self.taken:.2f} | {self.wall:.2f} | {self.megabytes:.0f} | "
            f"{self.code}"
        )
        return f"| {self.part} | {self.name} | {figures} | {self.wrong} |"


@dataclass
class Started:
    """A command that runs in a session of its own."""

    process: subprocess.Popen[bytes]
    said: Path
    began: float

    def end(self) -> tuple[int, float, float]:
        """Wait for it; its exit code, its time of the processor in seconds and its memory in
        megabytes.
        """
        while not (found := os.wait4(self.process.pid, os.WNOHANG))[0]:
            if time.monotonic() - self.began > HANGS:
                os.killpg(self.process.pid, signal.SIGKILL)
            time.sleep(0.02)
        _, status, used = found
        code = self.process.returncode = os.waitstatus_to_exitcode(status)
        return code, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def started(arguments: Sequence[str], folder: Path) -> Started:
    """Start a command line; what it writes goes into a file."""
    said = folder / "said"
    with said.open("wb") as out:
        process = subprocess.Popen(
            [*COMMAND, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
            env={**os.environ, "XDG_STATE_HOME": str(folder)},
        )
    return Started(process, said, time.monotonic())


def spent(session: int) -> float:
    """Seconds of the processor that all processes of a session have taken, with those that have
    ended in them.
    """
    return sum(sum(map(int, fields[11:15])) for fields in _members(session)) / TICK


def left(session: int) -> int:
    """How many processes of a session have not ended."""
    return sum(fields[0] != "Z" for fields in _members(session))


def _members(session: int) -> Iterator[list[str]]:
    """The fields of /proc/PID/stat behind the name, for each process of a session."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                fields = (entry / "stat").read_text("ascii", "replace").rpartition(")")[2].split()
                if int(fields[3]) == session:
                    yield fields


def remnants(session: int) -> str:
    """What is wrong if processes stay behind a second after the end of a command.

    They are ended.
    """
    until = time.monotonic() + 1
    while (count := left(session)) and time.monotonic() < until:
        time.sleep(0.05)
    if count:
        with suppress(ProcessLookupError):
            os.killpg(session, signal.SIGKILL)
    return f"{count} processes stay" if count else ""


def _text(said: Path) -> str:
    """What should never be printed.

    A traceback of Python's own start, before any file of this project, is not meant.
    """
    found = said.read_text("utf-8", "replace")
    begun = "Failed to import the site module" not in found
    ours = begun and any(
        f"{folder}{os.sep}" in found for folder in ("engine", "kb", "site-packages")
    )
    return (
        "traceback"
        if "Traceback" in found and ours
        else "internal error"
        if "internal error" in found
        else ""
    )


def _unexpected(code: int, said: Path) -> str:
    """What is wrong with an exit code.

    To refuse rules that have no end of facts is an answer, too.
    """
    endless = code == 2 and "K307" in said.read_text("utf-8", "replace")
    return "" if endless or code in ANSWERED | {23} else f"exit {code}"


def limited(work: Work, folder: Path, seconds: float) -> Row:
    """A command under a limit of time."""
    run = started([*work.arguments, "--time-limit", str(seconds)], folder)
    code, taken, megabytes = run.end()
    wall = time.monotonic() - run.began
    over = min(taken / work.processes, wall) - seconds
    wrong = [_text(run.said), remnants(run.process.pid)]
    wrong.append(f"{over:.2f} s over" if over > max(0.1 * seconds, 0.5) else "")
    wrong.append(_unexpected(code, run.said))
    return Row(
        "time", work.name, seconds, taken, wall, megabytes, code, "; ".join(filter(None, wrong))
    )


def bounded(work: Work, folder: Path, megabytes: int, seconds: float) -> Row:
    """A command under a limit of memory."""
    run = started(
        [*work.arguments, "--memory-limit", str(megabytes), "--time-limit", str(10 * seconds)],
        folder,
    )
    code, _, taken = run.end()
    wall = time.monotonic() - run.began
    wrong = [_text(run.said), remnants(run.process.pid), _unexpected(code, run.said)]
    wrong.append(f"{taken - megabytes:.0f} MB over" if taken > 1.1 * megabytes else "")
    return Row(
        "memory",
        work.name,
        float(megabytes),
        taken,
        wall,
        taken,
        code,
        "; ".join(filter(None, wrong)),
    )


def interrupted(work: Work, folder: Path, after: float) -> Row:
    """A command that is told to end at a moment, as a terminal does it: all its processes get
    the signal.
    """
    run = started(work.arguments, folder)
    session = run.process.pid
    while (
        run.process.poll() is None
        and spent(session) < after
        and time.monotonic() < run.began + IDLE
    ):
        time.sleep(0.002)
    before, taken, at = spent(session), 0.0, time.monotonic()
    if run.process.returncode is not None:
        return Row("interrupt", work.name, after, 0, 0, 0, run.process.returncode, _text(run.said))
    for _ in range(work.presses):
        os.killpg(session, signal.SIGINT)
        before, at = spent(session), time.monotonic()
        time.sleep(PRESSED)
    while run.process.poll() is None and time.monotonic() - at < 60:
        now = spent(session)
        taken = max(now - before, 0.0)
        time.sleep(0.01)
    wall, stays = time.monotonic() - at, run.process.poll() is None
    wrong = ["does not end" if stays else "", remnants(session), _text(run.said)]
    code = run.process.wait()
    wrong.append(f"{taken:.2f} s of the processor" if min(taken / work.processes, wall) > 1 else "")
    wrong.append("" if code in ANSWERED | {130, -signal.SIGINT} else f"exit {code}")
    return Row("interrupt", work.name, after, taken, wall, 0, code, "; ".join(filter(None, wrong)))


@contextmanager
def loaded(count: int) -> Iterator[None]:
    """So many busy processes run meanwhile."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.wait()


def rows(asked: argparse.Namespace, folder: Path) -> Iterator[Row]:
    """All rows that are asked for."""
    chance = random.Random(asked.seed)
    for work in works(folder):
        if asked.only not in work.name:
            continue
        if "time" in asked.part:
            yield limited(work, folder, asked.seconds)
        if "memory" in asked.part:
            yield bounded(work, folder, work.megabytes, asked.seconds)
        if "interrupt" in asked.part:
            starts = [chance.uniform(0.0, 0.7) for _ in range(asked.times // 2)]
            for after in [
                *starts,
                *(chance.uniform(0.7, 4.0) for _ in range(asked.times - len(starts))),
            ]:
                yield interrupted(work, folder, after)


def main() -> int:
    """Print a row for each trial, and what missed its bar."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("time", "memory", "interrupt")
    parser.add_argument("--part", nargs="+", choices=parts, default=parts)
    parser.add_argument("--only", default="", help="works whose names contain this")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument(
        "--times", type=int, default=4, help="moments at which each work is interrupted"
    )
    parser.add_argument("--load", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    # commands must not inherit that it is ignored
    signal.signal(signal.SIGINT, signal.default_int_handler)
    found = list[Row]()
    print(
        "| part | work | asked | taken | wall, s | MB | exit | wrong "
        "|\n|---|---|--:|--:|--:|--:|--:|---|"
    )
    with tempfile.TemporaryDirectory() as name, loaded(asked.load):
        for each in rows(asked, Path(name)):
            found.append(each)
            print(each.line(), flush=True)
    if asked.json:
        asked.json.write_text(json.dumps([asdict(each) for each in found], indent=1), "utf-8")
    wrong = sum(bool(each.wrong) for each in found)
    print(f"\n{len(found)} trials, {wrong} missed a bar")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
