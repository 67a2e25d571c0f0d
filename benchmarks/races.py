"""Two hosts that want to drive one run at the same time: one drives, the other sends nothing.

    python benchmarks/races.py [--races N] [--database sqlite|postgresql] [--seed N]

Each host is a process with a state folder of its own, and counts as another machine. They share a
database and a controller that writes down who says what. Three kinds of races take turns: both
begin a run of one name; both take a run up that was stopped; one is halted by SIGSTOP while it
drives, the other takes the run up, and the first one goes on. Of all lines that the controller
gets, only those of one host may count at any time; of the first two kinds the other one must not
have said a word. Exits with 1 if a race ends otherwise.
"""

import argparse
import json
import os
import random
import signal
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from controllers import Server
from postgres import served

from cellwright.engine.model.run_protocol import OperatorCommand
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    list_run,
    resume_run,
    run_start,
)
from cellwright.engine.pipelines.execution.controllers.reference_controller import Conversation
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import run_lease
from cellwright.kb.store.run_lease import LeasePace, ProcessIdentity, taken_lease

TARGET = "themse/one"
PACE = LeasePace(beat_s=0.05, lapse_s=0.6, look_s=0.02)
KINDS = ("begin", "resume", "stall")
FACTOR = 0.0002  # of real time, so that a run lasts a second
PATIENCE_S = 60.0
QUIET_QUESTIONS = ("ping", "bye")


@dataclass
class Scribe(Server):
    """A controller that writes down each line: the fencing number, the question, and whether it was
    refused.
    """

    said: list[tuple[int, str, bool]] = field(default_factory=list)

    def __init__(self, problem: Problem, factor: float) -> None:
        self.said, self.lock = [], threading.Lock()
        super().__init__(problem, factor=factor)

    def _converse(self, line: socket.socket) -> None:
        conversation = Conversation(self.cell)
        line.settimeout(0.01)
        waiting = b""
        while True:
            try:
                part = line.recv(65_536)
                if not part:
                    return
                waiting += part
            except TimeoutError:
                pass
            *texts, waiting = waiting.split(b"\n")
            answers = list[bytes]()
            for text in texts:
                asked = json.loads(text)
                with self.lock:
                    answers += conversation.answers(text + b"\n")
                refused = bool(answers) and b'"refused"' in answers[-1]
                if asked["type"] not in QUIET_QUESTIONS:
                    self.said.append((asked.get("fence", 0), asked["type"], refused))
            with self.lock:
                answers += conversation.ticks()
            line.sendall(b"".join(answers))


def prepare(problem: Problem, ready: ReadyPlan, host: str) -> None:
    """Have this process count as a host of its own, whose leases are quick."""
    identity = ProcessIdentity(host, os.getpid(), "1")
    run_lease.own_identity = lambda: identity
    run_start.taken_lease = partial(taken_lease, pace=PACE)  # type: ignore[assignment]
    run_start.first_plan = lambda *_: ready  # type: ignore[assignment]
    run_start._read_problem = lambda *_: problem


def serve_host(commands: Connection, host: str) -> None:
    """A host: carries out what it is told, one after another, and says how each ended."""
    problem = problem_of(TARGET)
    ready = first_plan(problem)
    assert isinstance(ready, ReadyPlan)
    prepare(problem, ready, host)
    commands.send("ready")
    while (asked := commands.recv()) is not None:
        what, request, moment = asked
        time.sleep(max(0.0, moment - time.time()))
        try:
            commands.send(drive(what, request, problem))
        except InvalidInput as error:
            commands.send(f"refused: {error.diagnostics[0].message}")


def drive(what: str, request: RunRequest, problem: Problem) -> str:
    """Begin or take up a run; how it ended."""
    if what == "begin":
        with list_run(request, problem) as named_request:
            ending = begin_run(named_request, problem, TimedOrders())
    else:
        ending = resume_run(request.store, request.run, TimedOrders())
    return f"{ending.outcome}: {ending.why}"  # type: ignore[union-attr]


@dataclass
class Host:
    """A process that counts as a host."""

    process: object
    pid: int
    commands: Connection

    def answer(self) -> str:
        """What the host says at the end of its part."""
        if not self.commands.poll(PATIENCE_S):
            return "silent"
        return str(self.commands.recv())


def started_host(name: str, folder: Path) -> Host:
    """A host with a state folder of its own."""
    os.environ["XDG_STATE_HOME"] = str(folder / name)
    context = get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=serve_host, args=(there, name), daemon=True)
    process.start()
    assert process.pid is not None
    assert here.recv() == "ready"
    return Host(process, process.pid, here)


@dataclass
class Race:
    """One race: the hosts, the problem, where the journal is, and how its times are drawn."""

    hosts: tuple[Host, Host]
    problem: Problem
    store: str
    run: str
    chance: random.Random
    facts: Counter[str]

    def wanted(self, server: Scribe) -> RunRequest:
        """The run that both want to drive."""
        options = {"address": f"127.0.0.1:{server.place.port}"}
        request = RunRequest(TARGET, driver="external", store=self.store, run=self.run)
        return replace(request, options=options)

    def together(self, what: str, request: RunRequest) -> list[str]:
        """Both do the same, within some milliseconds; how it ended for each, the winner first."""
        now = time.time() + 0.02
        for host in self.hosts:
            host.commands.send((what, request, now + self.chance.uniform(0, 0.03)))
        return sorted(
            (host.answer() for host in self.hosts), key=lambda said: said[:7] == "refused"
        )

    def begin(self, server: Scribe) -> str:
        """Both begin a run of one name."""
        return one_drove(server, self.together("begin", self.wanted(server)))

    def resume(self, server: Scribe) -> str:
        """Both take up a run that was stopped."""
        stop = TimedOrders(
            [(self.chance.randrange(1_000, 900_000), GivenOrder(OperatorCommand.STOP))]
        )
        with list_run(self.wanted(server), self.problem) as named_request:
            begin_run(named_request, self.problem, stop)
        server.said.clear()
        return one_drove(server, self.together("resume", self.wanted(server)))

    def stall(self, server: Scribe) -> str:
        """One stands still while it drives; the other takes the run up; then the first goes on."""
        first, second = self.chance.sample(self.hosts, 2)
        first.commands.send(("begin", self.wanted(server), 0.0))
        began = time.time()
        until = began + self.chance.uniform(0.15, 0.9)
        while time.time() < until or not any(type_ == "send" for _, type_, _ in server.said):
            if time.time() > began + PATIENCE_S:
                return "the first one is silent"
            if first.commands.poll():
                return "" if str(first.commands.recv()).startswith("reached") else "it never drove"
            time.sleep(0.001)
        os.kill(first.pid, signal.SIGSTOP)
        fence = server.said[0][0]
        try:
            second.commands.send(("resume", self.wanted(server), 0.0))
            while not any(other != fence for other, _, _ in list(server.said)):
                if second.commands.poll() or time.time() > began + PATIENCE_S:
                    break
                time.sleep(0.001)
        finally:
            os.kill(first.pid, signal.SIGCONT)
        ends = second.answer(), first.answer()
        told = [each for each in server.said if each[0] == fence]
        behind = server.said[
            next((n for n, each in enumerate(server.said) if each[0] != fence), 0) :
        ]
        obeyed = [type_ for other, type_, refused in behind if other == fence and not refused]
        if ends[1].startswith("reached") and ends[0].startswith("refused"):
            return ""  # it was done before it stood still
        if not ends[0].startswith("reached") or not ends[1].startswith("stopped"):
            return f"ended otherwise: {ends}, {len(told)} lines"
        refused = sum(other == fence and is_refused for other, _, is_refused in behind)
        self.facts["taken over while one stood still"] += 1
        self.facts["lines of the first one that the controller refused then"] += refused
        return f"obeyed the one that was replaced: {obeyed}" if obeyed else ""


def one_drove(server: Scribe, ends: list[str]) -> str:
    """What is wrong with a race of two; empty if one drove and the other said nothing."""
    fences = {fence for fence, _, _ in server.said}
    if not ends[0].startswith("reached") or not ends[1].startswith("refused"):
        return f"ended otherwise: {ends}"
    return "" if len(fences) == 1 and 0 not in fences else f"several said something: {fences}"


def run_race(race: Race, kind: str) -> str:
    """One race; what is wrong with it, empty if nothing."""
    server = Scribe(race.problem, FACTOR if kind == "stall" else 0.0)
    try:
        kinds: dict[str, Callable[[Scribe], str]] = {
            "begin": race.begin, "resume": race.resume, "stall": race.stall,
        }  # fmt: skip
        return kinds[kind](server)
    finally:
        server.close()


@contextmanager
def two_hosts(folder: Path):  # type: ignore[no-untyped-def]
    """Two hosts, each a process of its own."""
    hosts = started_host("one", folder), started_host("other", folder)
    try:
        yield hosts
    finally:
        for host in hosts:
            host.commands.send(None)


def main() -> int:
    """Run the races, and print what went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--races", type=int, default=200)
    parser.add_argument("--database", choices=("sqlite", "postgresql"), default="sqlite")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tell", type=int, default=20, help="races between two lines")
    asked = parser.parse_args()
    problem, began = problem_of(TARGET), time.monotonic()
    ready = first_plan(problem)
    assert isinstance(ready, ReadyPlan)
    prepare(problem, ready, "referee")
    counts, facts, wrong = Counter[str](), Counter[str](), 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        database = served() if asked.database == "postgresql" else nullcontext(str(folder / "j.db"))
        with database as store, two_hosts(folder) as hosts:
            for number in range(asked.races):
                kind = KINDS[number % len(KINDS)]
                chance = random.Random(f"{asked.seed} {number}")
                said = run_race(Race(hosts, problem, store, f"race-{number}", chance, facts), kind)
                counts[kind] += 1
                if said:
                    wrong += 1
                    print(f"race {number} ({kind}): {said}", flush=True)
                if number % asked.tell == asked.tell - 1:
                    passed = time.monotonic() - began
                    print(f"{number + 1} races in {passed:.0f} s, {wrong} wrong", flush=True)
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    took = time.monotonic() - began
    print(f"{asked.database}: {asked.races} races ({kinds}) in {took:.0f} s, {wrong} wrong")
    print("\n".join(f"{count} {fact}" for fact, count in facts.items()))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
