"""What all pages share: the runs of a store, orders to them, and commands that pages start."""

import os
import pty
import re
import secrets
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cellwright.engine.faces.monitor.access_control import IdempotencyCache
from cellwright.engine.faces.monitor.background_answers import RunMotions, Target, worker_pool
from cellwright.engine.faces.monitor.cell_bodies import CellBodies, solids_of
from cellwright.engine.faces.monitor.measurement_sheets import Sheets
from cellwright.engine.faces.monitor.run_follower import RunFollower, runs_of
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.run_socket import going_on, tell_run
from cellwright.engine.pipelines.planning.target_files import problem_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Begun, Journal

# what is shown with its progress
LONG_COMMANDS = ("prepare", "sequence", "plan", "schedule", "test")
CONTROL_SEQUENCE = re.compile(r"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b[@-_]|[\x00-\x08\x0b\x0c\x0e-\x1f]")
MAX_OUTPUT_CHARS = 20_000  # characters of what a command prints
COMMAND_LINE = (sys.executable, "-m", "cellwright.engine.faces.cli")


@dataclass
class PageCommand:
    """A command of the command line that works: `text` is what it has printed last, `code` how
    it ended.
    """

    words: tuple[str, ...]
    text: str = ""
    code: int | None = None
    began_s: float = field(default_factory=time.monotonic)
    lasted_s: float = 0.0

    @property
    def seconds(self) -> float:
        """How long it has worked."""
        return self.lasted_s if self.code is not None else time.monotonic() - self.began_s


def start_command(words: Sequence[str], folder: Path) -> PageCommand:
    """A command that works with a terminal of its own, so that it tells of its progress."""
    ours, theirs = pty.openpty()
    job = PageCommand(tuple(words))
    size = {**os.environ, "COLUMNS": "110", "LINES": "40", "TERM": "xterm"}
    process = subprocess.Popen(
        [*COMMAND_LINE, *words], cwd=folder, env=size, stdin=subprocess.DEVNULL, stdout=theirs,
        stderr=theirs, start_new_session=True
    )  # fmt: skip
    os.close(theirs)
    threading.Thread(target=_follow_output, args=(job, process, ours), daemon=True).start()
    return job


def _follow_output(job: PageCommand, process: subprocess.Popen[bytes], ours: int) -> None:
    raw = ""
    with os.fdopen(ours, "rb", buffering=0) as stream:
        while True:
            try:
                part = stream.read(4096)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            raw = (raw + part.decode("utf-8", "replace"))[-MAX_OUTPUT_CHARS:]
            job.text = terminal_text(raw)
    job.code, job.lasted_s = process.wait(), time.monotonic() - job.began_s


def terminal_text(raw: str) -> str:
    """What a terminal would show of a text: without control sequences, each line as it was
    written last.
    """
    lines = CONTROL_SEQUENCE.sub("", raw.replace("\r\n", "\n")).split("\n")
    return "\n".join(line.rstrip("\r").rpartition("\r")[2].rstrip() for line in lines).strip()


def start_run(
    words: Sequence[str], folder: Path, there: Callable[[], bool], wait_s: float = 60.0
) -> str:
    """Start a run in the background; what it complained of if it ended before it was `there`,
    else nothing.
    """
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:
        process = subprocess.Popen(
            [*COMMAND_LINE, *words], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said,
            start_new_session=True,
        )  # fmt: skip
        threading.Thread(target=process.wait, daemon=True).start()
        until = time.monotonic() + wait_s
        while time.monotonic() < until:
            over = process.poll() is not None
            if there():
                return ""
            if over:
                said.seek(0)
                return said.read().strip() or f"ended with {process.returncode}"
            time.sleep(0.1)
    return "it has not begun yet; it may still do so"


GOING_S = 0.5  # between two questions which runs go on
JOURNAL_PAUSE_S = 0.05  # between two looks at a journal


@dataclass
class SharedState:
    """The runs of a store, followed while somebody looks at them.

    With `read_only` no page gives orders.
    """

    store: str
    read_only: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    once: IdempotencyCache = field(default_factory=IdempotencyCache)
    sheets: Sheets = field(default_factory=lambda: Sheets(Path.cwd()))
    _followed: dict[str, RunFollower] = field(default_factory=dict)
    _looked: dict[str, float] = field(default_factory=dict)
    _reading: threading.Lock = field(default_factory=threading.Lock)
    _asking: threading.Lock = field(default_factory=threading.Lock)
    _going: frozenset[str] = frozenset()
    _asked_s: float = -GOING_S
    jobs: list[PageCommand] = field(default_factory=list)
    _motions: dict[str, RunMotions] = field(default_factory=dict)

    def runs(self) -> tuple[Begun, ...]:
        """The runs of the store, the newest first."""
        return runs_of(self.store)

    def outcomes(self, runs: Collection[str]) -> dict[str, str]:
        """How runs have ended, as their last records of an end say; empty for those that have
        none.
        """
        with Journal(self.store) as journal:
            ends = {run: journal.line(run, journal.last(run, RecordKind.END.value)) for run in runs}
        return {
            run: str(end.content.get("outcome", "")) if end else "" for run, end in ends.items()
        }

    def going_on(self) -> frozenset[str]:
        """The names of the runs of this store that go on in some process of this user."""
        return frozenset(
            str(going["run"]) for going in going_on() if going["store"] in (self.store, "")
        )

    def goes_on(self, run: str) -> bool:
        """Whether a run goes on, as it was known a second ago: a process that hangs must not
        hold up the pages.
        """
        if time.monotonic() - self._asked_s > GOING_S and not self._asking.locked():
            self._asked_s = time.monotonic()
            threading.Thread(target=self._ask, daemon=True).start()
        return run in self._going

    def _ask(self) -> None:
        with self._asking:
            self._going = self.going_on()

    def follow(self, run: str) -> RunFollower:
        """The run, read up to now. Raises `InvalidInput` if the store has none of this name."""
        with self._reading:
            if run not in self._followed:
                self._followed[run] = RunFollower(self.store, run, _initial_facts(self.store, run))
                self._followed[run].refresh()
            if time.monotonic() - self._looked.get(run, 0.0) >= JOURNAL_PAUSE_S:
                self._followed[run].refresh()
                self._looked[run] = time.monotonic()
            return self._followed[run]

    def target(self, run: str) -> Target:
        """What the run was begun with."""
        return _target_of(self.follow(run))

    def solids(self, run: str) -> CellBodies:
        """The bodies of the run's cell.

        Raises `InvalidInput` if its target or its cell is not there any more.
        """
        return solids_of(_target_of(self.follow(run))[0])

    def motions(self, run: str) -> RunMotions:
        """The motions of the run's steps, as far as they are found."""
        if run not in self._motions:
            self._motions[run] = RunMotions(self.store, run, _target_of(self.follow(run)))
        return self._motions[run]

    @cached_property
    def workers(self) -> ProcessPoolExecutor:
        """The process in which motions and ways are looked for."""
        return worker_pool()

    async def find_motions(self, run: str) -> None:
        """Look for the motions of all steps that the run has begun."""
        await self.motions(run).refresh(len(self.follow(run).records), self.workers)

    def measure(self, key: str, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Change the measurements of a problem file as a page asks, once; the status code and
        what is told of it.
        """
        return self._once(key, lambda: self._changed(asked))

    def _changed(self, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        try:
            return 200, {"said": self.sheets.change(asked), "done": True}
        except InvalidInput as refused:
            return 409, {
                "said": "; ".join(diagnostic.message for diagnostic in refused.diagnostics)
            }

    def order(self, key: str, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Give a run the order that a page asks for, once; the status code and what is told of
        it.
        """
        return self._once(key, lambda: self._told(asked))

    def _once(
        self, key: str, make: Callable[[], tuple[int, dict[str, Any]]]
    ) -> tuple[int, dict[str, Any]]:
        if self.read_only:
            return 403, {"said": "this monitor only watches"}
        if not key:
            return 400, {"said": "a changing request needs an Idempotency-Key"}
        answer: tuple[int, dict[str, Any]] = self.once.answer(key, make)
        return answer

    def _told(self, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        run, order, text, who = (
            str(asked.get(name, "")) for name in ("run", "order", "text", "who")
        )
        if order in STARTING_ORDERS:
            return self._started(order, run, asked)
        if order not in PAGE_ORDERS:
            return 400, {"said": f"there is no order {order!r}"}
        try:
            state = tell_run(run, order, text, self.store, who or "monitor")
        except InvalidInput as refused:
            return 409, {
                "said": "; ".join(diagnostic.message for diagnostic in refused.diagnostics)
            }
        return 200, {"said": f"{run}: {order} {text}".strip(), **state}

    def _started(
        self, order: str, run: str, asked: Mapping[str, Any]
    ) -> tuple[int, dict[str, Any]]:
        """Start a run, resume one, or begin work that takes long."""
        if order == "work":
            words = _split_words(str(asked.get("text", "")))
            if not words or words[0] not in LONG_COMMANDS:
                return 400, {"said": f"what can be begun here: {', '.join(LONG_COMMANDS)}"}
            self.jobs.append(start_command(words, self.sheets.folder))
            return 200, {"said": f"begun: {shlex.join(words)}"}
        before = (
            {known_run.run for known_run in self.runs()}
            if order == "start"
            else self.going_on() - {run}
        )
        words = ["resume", run] if order == "resume" else _run_words(run, asked)

        def fresh() -> set[str]:
            """The run, once it takes orders."""
            return {*self.going_on()} - before

        refused = start_run(
            [words[0], "--store", self.store, *words[1:]], self.sheets.folder, lambda: bool(fresh())
        )
        new_run = next(
            iter(sorted(fresh() or {known_run.run for known_run in self.runs()} - before)), run
        )
        if refused:
            return 409, {"said": refused}
        return 200, {"said": f"{new_run}: goes on", "open": f"/run/{quote(new_run, safe='')}"}


def _split_words(text: str) -> list[str]:
    """The words of a command line; none if a quotation mark is left open."""
    try:
        return shlex.split(text)
    except ValueError:
        return []


def _run_words(run: str, asked: Mapping[str, Any]) -> list[str]:
    """The words of the command that starts a run; what begins with a dash is no option."""
    options = {"--name": run, "--driver": "", "--option": ""}
    options |= {
        f"--{name}": str(asked.get(name, ""))
        for name in ("command", "goals", "factor", "fault", "seed")
    }
    given = [f"{name}={value}" for name, value in options.items() if value]
    approve = ["--approve"] if asked.get("approve") else []
    return ["run", *given, *approve, "--", str(asked.get("target", ""))]


STARTING_ORDERS = ("start", "resume", "work")
PAGE_ORDERS = (
    "stop",
    "interrupt",
    "continue",
    "skip",
    "retry",
    "back",
    "correct",
    "abort",
    "add",
    "answer",
    "approve",
)


def _target_of(follower: RunFollower) -> Target:
    """What the run was begun with."""
    about = follower.about
    return str(about.get("target", "")), str(about.get("goals", "")), str(about.get("command", ""))


def _initial_facts(store: str, run: str) -> tuple[str, ...]:
    """The facts with which a run began; none if its target is no longer there."""
    try:
        problem = problem_of(*_target_of(RunFollower(store, run)))
        return tuple(sorted(map(str, initial_situation(problem).state)))
    except InvalidInput:
        return ()
