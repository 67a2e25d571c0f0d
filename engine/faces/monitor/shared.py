"""What all pages of a monitor share: the runs of a store, each read once, and the orders that pages give."""

import secrets
import shlex
import threading
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cellwright.engine.faces.monitor.door import Once
from cellwright.engine.faces.monitor.following import Follower, runs_of
from cellwright.engine.faces.monitor.jobs import LONG, Job, begun, started
from cellwright.engine.faces.monitor.motions import Motions, Target, workers
from cellwright.engine.faces.monitor.sheets import Sheets
from cellwright.engine.faces.monitor.solids import Solids, solids_of
from cellwright.engine.model.execution import RecordKind
from cellwright.engine.pipelines.execution.channel import going_on, tell
from cellwright.engine.pipelines.execution.compiling import situation_of
from cellwright.engine.pipelines.planning import problem_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Begun, Journal

GOING_S = 0.5  # between two questions which runs go on
PAUSE_S = 0.05  # between two looks at a journal


@dataclass
class Shared:
    """The runs of a store, followed while somebody looks at them. With `read_only` no page gives orders."""

    store: str
    read_only: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    once: Once = field(default_factory=Once)
    sheets: Sheets = field(default_factory=lambda: Sheets(Path.cwd()))
    _followed: dict[str, Follower] = field(default_factory=dict)
    _looked: dict[str, float] = field(default_factory=dict)
    _reading: threading.Lock = field(default_factory=threading.Lock)
    _asking: threading.Lock = field(default_factory=threading.Lock)
    _going: frozenset[str] = frozenset()
    _asked_s: float = -GOING_S
    jobs: list[Job] = field(default_factory=list)
    _motions: dict[str, Motions] = field(default_factory=dict)

    def runs(self) -> tuple[Begun, ...]:
        """The runs of the store, the newest first."""
        return runs_of(self.store)

    def outcomes(self, runs: Collection[str]) -> dict[str, str]:
        """How runs have ended, as their last records of an end say; empty for those that have none."""
        with Journal(self.store) as journal:
            ends = {run: journal.line(run, journal.last(run, RecordKind.END.value)) for run in runs}
        return {run: str(end.content.get("outcome", "")) if end else "" for run, end in ends.items()}

    def going_on(self) -> frozenset[str]:
        """The names of the runs of this store that go on in some process of this user."""
        return frozenset(str(each["run"]) for each in going_on() if each["store"] in (self.store, ""))

    def goes_on(self, run: str) -> bool:
        """Whether a run goes on, as it was known a second ago: a process that hangs must not hold up the pages."""
        if time.monotonic() - self._asked_s > GOING_S and not self._asking.locked():
            self._asked_s = time.monotonic()
            threading.Thread(target=self._ask, daemon=True).start()
        return run in self._going

    def _ask(self) -> None:
        with self._asking:
            self._going = self.going_on()

    def follow(self, run: str) -> Follower:
        """The run, read up to now. Raises `InvalidInput` if the store has none of this name."""
        with self._reading:
            if run not in self._followed:
                self._followed[run] = Follower(self.store, run, _initial(self.store, run))
                self._followed[run].refresh()
            if time.monotonic() - self._looked.get(run, 0.0) >= PAUSE_S:
                self._followed[run].refresh()
                self._looked[run] = time.monotonic()
            return self._followed[run]

    def target(self, run: str) -> Target:
        """What the run was begun with."""
        return _target(self.follow(run))

    def solids(self, run: str) -> Solids:
        """The bodies of the run's cell. Raises `InvalidInput` if its target or its cell is not there any more."""
        return solids_of(_target(self.follow(run))[0])

    def motions(self, run: str) -> Motions:
        """The motions of the run's steps, as far as they are found."""
        if run not in self._motions:
            self._motions[run] = Motions(self.store, run, _target(self.follow(run)))
        return self._motions[run]

    @cached_property
    def workers(self) -> ProcessPoolExecutor:
        """The process in which motions and ways are looked for."""
        return workers()

    async def find_motions(self, run: str) -> None:
        """Look for the motions of all steps that the run has begun."""
        await self.motions(run).refresh(len(self.follow(run).records), self.workers)

    def measure(self, key: str, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Change the measurements of a problem file as a page asks, once; the status code and what is told of it."""
        return self._once(key, lambda: self._changed(asked))

    def _changed(self, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        try:
            return 200, {"said": self.sheets.change(asked), "done": True}
        except InvalidInput as refused:
            return 409, {"said": "; ".join(each.message for each in refused.diagnostics)}

    def order(self, key: str, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Give a run the order that a page asks for, once; the status code and what is told of it."""
        return self._once(key, lambda: self._told(asked))

    def _once(self, key: str, make: Callable[[], tuple[int, dict[str, Any]]]) -> tuple[int, dict[str, Any]]:
        if self.read_only:
            return 403, {"said": "this monitor only watches"}
        if not key:
            return 400, {"said": "a changing request needs an Idempotency-Key"}
        found: tuple[int, dict[str, Any]] = self.once.answer(key, make)
        return found

    def _told(self, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        run, order, text, who = (str(asked.get(name, "")) for name in ("run", "order", "text", "who"))
        if order in STARTING:
            return self._started(order, run, asked)
        if order not in ORDERS:
            return 400, {"said": f"there is no order {order!r}"}
        try:
            state = tell(run, order, text, self.store, who or "monitor")
        except InvalidInput as refused:
            return 409, {"said": "; ".join(each.message for each in refused.diagnostics)}
        return 200, {"said": f"{run}: {order} {text}".strip(), **state}

    def _started(self, order: str, run: str, asked: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Start a run, resume one, or begin work that takes long."""
        if order == "work":
            words = _split(str(asked.get("text", "")))
            if not words or words[0] not in LONG:
                return 400, {"said": f"what can be begun here: {', '.join(LONG)}"}
            self.jobs.append(started(words, self.sheets.folder))
            return 200, {"said": f"begun: {shlex.join(words)}"}
        before = {each.run for each in self.runs()} if order == "start" else self.going_on() - {run}
        words = ["resume", run] if order == "resume" else _run_words(run, asked)

        def fresh() -> set[str]:
            """The run, once it takes orders."""
            return {*self.going_on()} - before

        refused = begun(
            [words[0], "--store", self.store, *words[1:]], self.sheets.folder, lambda: bool(fresh())
        )
        made = next(iter(sorted(fresh() or {each.run for each in self.runs()} - before)), run)
        if refused:
            return 409, {"said": refused}
        return 200, {"said": f"{made}: goes on", "open": f"/run/{quote(made, safe='')}"}


def _split(text: str) -> list[str]:
    """The words of a command line; none if a quotation mark is left open."""
    try:
        return shlex.split(text)
    except ValueError:
        return []


def _run_words(run: str, asked: Mapping[str, Any]) -> list[str]:
    """The words of the command that starts a run; what begins with a dash is no option."""
    options = {"--name": run, "--driver": "", "--option": ""}
    options |= {
        f"--{name}": str(asked.get(name, "")) for name in ("command", "goals", "factor", "fault", "seed")
    }
    given = [f"{name}={value}" for name, value in options.items() if value]
    approve = ["--approve"] if asked.get("approve") else []
    return ["run", *given, *approve, "--", str(asked.get("target", ""))]


STARTING = ("start", "resume", "work")
ORDERS = (
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


def _target(follower: Follower) -> Target:
    """What the run was begun with."""
    about = follower.about
    return str(about.get("target", "")), str(about.get("goals", "")), str(about.get("command", ""))


def _initial(store: str, run: str) -> tuple[str, ...]:
    """The facts with which a run began; none if its target is no longer there."""
    try:
        problem = problem_of(*_target(Follower(store, run)))
        return tuple(sorted(map(str, situation_of(problem).state)))
    except InvalidInput:
        return ()
