"""What a run survives: a loss of power, a full disk, a controller that misbehaves. One table each.

    python benchmarks/mishaps.py [--target TARGET] [--fault STEP=CAUSE] [--times N] [--seed N]
        [TABLE ...]

TABLE is power, disk or controller; left out, all. A run in a simulated cell has a fault in it. For
`power` its process is gone behind a random group of records, and the journal's files are cut at a
random byte behind their last sync. For `disk` no file may grow beyond a random size. The cell lives
on with a log of its own. No record may be missing that was acknowledged, the run has to be resumed
and to reach the same goals, and no command may be carried out twice. For `controller` a controller
in this process answers as the table says. The run has to go on, or to end with what went wrong,
within the time limit of the command. Exits with 1 if something is wrong.
"""

import argparse
import json
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from controllers import Manners, Server, ahead, at_reply, later

from cellwright.engine.model.run_protocol import Finish, JournalRecord, RecordKind
from cellwright.engine.pipelines.execution import (
    RunExecution,
    RunRequest,
    TimedOrders,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.controllers import ControllerDriver
from cellwright.engine.pipelines.execution.controllers.link import Patience
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.execution.run_start import JournalLedger, run_document
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import fault_base, simulated_driver
from cellwright.engine.ports import Driver, DriverSetup
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal
from cellwright.kb.store.run_lease import RunLease

HURRY = Patience(5, 2, 0.2, 1.5)
TELLS = ("reached", "partly")


class Gone(BaseException):
    """The process is gone."""


def without_lease(request: RunRequest, problem: Problem) -> RunRequest:
    """The same under the name of a new run, which another process shall drive."""
    named_request = name_run(request, problem)
    assert named_request.lease is not None
    named_request.lease.close()
    return replace(named_request, lease=None)


@dataclass(frozen=True)
class Setting:
    """What is run, again and again: the problem and its plan."""

    target: str
    fault: str
    problem: Problem
    ready: ReadyPlan

    def wanted(self, folder: Path) -> RunRequest:
        """A run with its journal and the log of its cell in a folder."""
        options = {"log": str(folder / "cell.log"), **({"fault": self.fault} if self.fault else {})}
        return without_lease(
            RunRequest(self.target, store=str(folder / "runs.db"), options=options), self.problem
        )

    def run(
        self,
        wanted: RunRequest,
        driver: Driver,
        ledger: JournalLedger,
        records: list[JournalRecord],
    ) -> Finish:
        """A run from its beginning."""
        recorder = Recorder(ledger, driver.now_ms, [records.append])
        recorder.note(RecordKind.RUN, **run_document(wanted, self.problem))
        base = fault_base(self.problem)
        execution = RunExecution(wanted.run, self.problem, driver, recorder, TimedOrders(), base)
        return execution.start(
            self.ready, SymbolicWorld.of(self.problem, initial_situation(self.problem).state)
        )

    def setup(self, wanted: RunRequest) -> DriverSetup:
        """What the cell of a run is made for."""
        return DriverSetup(self.problem, wanted.run, 0, 0.0, dict(wanted.options))


@dataclass
class Cut(JournalLedger):
    """A journal whose process is gone behind a group: all is copied as the disk has it, and cut
    behind the last sync.
    """

    journal: Journal
    run: str
    group: int
    chance: random.Random
    copy: Path
    synced: int = 0
    acknowledged: int = 0
    count: int = field(default=0)
    lease: RunLease | None = None

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records; those of the last group are never acknowledged."""
        super().append(records)
        self.count += 1
        log = Path(f"{self.journal.target}-wal")
        if self.count <= self.group:
            self.synced, self.acknowledged = log.stat().st_size, records[-1].number
            return
        shutil.copy(self.journal.target, self.copy / "runs.db")
        content = log.read_bytes()
        at = self.chance.randrange(self.synced, len(content) + 1)
        (self.copy / "runs.db-wal").write_bytes(content[:at])
        raise Gone


def power(setting: Setting, times: int, seed: int) -> Iterator[tuple[str, str]]:
    """What came of each loss of power, and what is wrong."""
    with tempfile.TemporaryDirectory() as name:
        whole, counted = Path(name), list[JournalRecord]()
        groups = _groups(setting, whole, counted)
    for number in range(times):
        chance = random.Random(f"{seed} power {number}")
        with tempfile.TemporaryDirectory() as name:
            folder, after = Path(name), Path(name) / "after"
            after.mkdir()
            wanted, group = setting.wanted(folder), chance.randrange(1, groups)
            with Journal(wanted.store) as journal:
                driver, cut = (
                    simulated_driver(setting.setup(wanted)),
                    Cut(journal, wanted.run, group, chance, after),
                )
                with suppress(Gone):
                    setting.run(wanted, driver, cut, [])
                driver.close()
            store = str(after / "runs.db")
            with Journal(store) as journal:
                kept = journal.last(wanted.run)
            if kept < cut.acknowledged:
                yield (
                    "lost",
                    f"group {group}: {cut.acknowledged - kept} acknowledged records are missing",
                )
            else:
                yield _again(store, wanted.run, folder / "cell.log")


def _groups(setting: Setting, folder: Path, records: list[JournalRecord]) -> int:
    """How many groups of records a run has that nothing happens to."""
    counted = list[int]()

    class Counting(JournalLedger):
        def append(self, group: Sequence[JournalRecord]) -> None:
            super().append(group)
            counted.append(len(group))

    wanted = setting.wanted(folder)
    with Journal(wanted.store) as journal:
        driver = simulated_driver(setting.setup(wanted))
        ending = setting.run(wanted, driver, Counting(journal, wanted.run), records)
        driver.close()
    assert ending.outcome in TELLS, ending
    return len(counted)


def _again(store: str, run: str, log: Path) -> tuple[str, str]:
    """How a run ends that is taken up again, and what is wrong."""
    try:
        ending = resume_run(store, run, TimedOrders())
    except InvalidInput as error:
        return "refused", str(error.diagnostics[0].message)
    entries = [json.loads(each) for each in log.read_text("utf-8").splitlines() if each]
    twice = [
        n for n, count in Counter(e["ended"] for e in entries if "ended" in e).items() if count > 1
    ]
    if twice:
        return ending.outcome, f"commands carried out twice: {twice}"
    return ending.outcome, "" if ending.outcome in TELLS else ending.why


@contextmanager
def smallest(size: int) -> Iterator[None]:
    """No file may grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def disk(setting: Setting, times: int, seed: int) -> Iterator[tuple[str, str]]:
    """What came of each disk that was full, and what is wrong."""
    with tempfile.TemporaryDirectory() as name:
        _groups(setting, Path(name), [])
        largest = sum(each.stat().st_size for each in Path(name).glob("runs.db*"))
    for number in range(times):
        chance = random.Random(f"{seed} disk {number}")
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            wanted = setting.wanted(folder)
            with Journal(wanted.store) as journal:
                driver = simulated_driver(setting.setup(wanted))
                with smallest(chance.randrange(80_000, max(100_000, largest))):
                    ending = setting.run(wanted, driver, JournalLedger(journal, wanted.run), [])
                driver.close()
            if ending.outcome in TELLS:
                yield "it was large enough", ""
            elif "the journal cannot be written" not in ending.why:
                yield "not told", ending.why
            else:
                outcome, wrong = _again(wanted.store, wanted.run, folder / "cell.log")
                yield f"stopped, told, {outcome}", wrong


# what a controller does, and which trouble or exception has to be told, and how the run may end
MANNERS: Mapping[str, tuple[Manners, str, tuple[str, ...]]] = {
    "behaves": (lambda _, lines: lines, "", ("reached",)),
    "hangs": (lambda heard, lines: lines if heard < 8 else [], "lost", ("stopped",)),
    "dies": (lambda heard, lines: lines if heard < 8 else None, "lost", ("stopped",)),
    "dies and is back": (
        lambda heard, lines: None if heard in (6, 11, 12) else lines,
        "",
        ("reached",),
    ),
    "answers twice": (at_reply(3, lambda line: [line, line]), "repeated", ("reached",)),
    "answers out of order": (at_reply(3, ahead), "strange", ("reached",)),
    "answers late": (at_reply(3, later), "late", (*TELLS, "stopped")),
    "says garbage beside": (at_reply(3, lambda line: [b"\xff{{\n", line]), "garbage", ("reached",)),
    "says garbage instead": (at_reply(3, lambda _: [b"{}\n"]), "timeout", (*TELLS, "stopped")),
    "says nothing": (at_reply(3, lambda _: []), "timeout", (*TELLS, "stopped")),
}


def controller(setting: Setting, _times: int, _seed: int) -> Iterator[tuple[str, str]]:
    """What came of each kind of controller, and what is wrong."""
    for name, (manners, wanted_told, endings) in MANNERS.items():
        server, records = Server(setting.problem, manners), list[JournalRecord]()
        with tempfile.TemporaryDirectory() as folder:
            wanted = setting.wanted(Path(folder))
            with Journal(wanted.store) as journal:
                driver = ControllerDriver(server.place, HURRY, wanted.run)
                began = time.monotonic()
                ending = setting.run(wanted, driver, JournalLedger(journal, wanted.run), records)
                driver.close()
        server.listener.close()
        said = told(records)
        wrong = "" if ending.outcome in endings else f"it ended {ending.outcome}: {ending.why}"
        wrong = wrong or ("" if wanted_told in ("", *said) else f"{wanted_told} was not told")
        wrong = wrong or too_late(records)
        causes = [str(r.content["causes"][0][0]) for r in records if r.kind is RecordKind.DIAGNOSIS]
        found = f"; cause: {', '.join(causes)}" if causes else ""
        seconds = time.monotonic() - began
        yield (
            f"{name}: told {', '.join(said) or 'nothing'}{found}; {ending.outcome} in "
            f"{seconds:.1f} s",
            wrong,
        )


def told(records: Sequence[JournalRecord]) -> list[str]:
    """Which troubles and which bad replies the journal tells of."""
    found = [r.content["trouble"] for r in records if r.kind is RecordKind.TROUBLE]
    found += [r.content["reply"] for r in records if r.kind is RecordKind.EXCEPTION]
    return list(dict.fromkeys(found))


def too_late(records: Sequence[JournalRecord]) -> str:
    """Which command was given up later than its time limit, or by more than a second of grace;
    empty if none was.
    """
    sent = {r.content["command"]: r for r in records if r.kind is RecordKind.COMMAND}
    quiet = next(
        (r for r in records if r.kind is RecordKind.PHASE and r.content["phase"] == "quiescing"),
        None,
    )
    failed = next((r for r in records if r.kind is RecordKind.EXCEPTION), None)
    if quiet is None or failed is None or failed.content["reply"] != "timeout":
        return ""
    command = sent[failed.content["command"]]
    late = quiet.at_ms - command.at_ms - command.content["timeout_ms"]
    return (
        f"command {command.content['command']} was given up {late} ms late" if late > 1_000 else ""
    )


TABLES = {"power": power, "disk": disk, "controller": controller}


def main() -> int:
    """Print the tables; 1 if something is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", metavar="TABLE", help="power, disk or controller")
    parser.add_argument("--target", default="themse/one")
    parser.add_argument("--fault", default="pick=not_gripped")
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    problem = problem_of(asked.target)
    ready = first_plan(problem)
    assert isinstance(ready, ReadyPlan), ready
    wrong = 0
    for name in asked.tables or TABLES:
        counted = Counter[str]()
        for outcome, found in TABLES[name](
            Setting(asked.target, asked.fault, problem, ready), asked.times, asked.seed
        ):
            counted[outcome] += 1
            wrong += bool(found)
            if found:
                print(f"  {name}: {outcome}: {found}", flush=True)
        for outcome, count in counted.items():
            print(f"{name:<12} {count:>5}  {outcome}", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
