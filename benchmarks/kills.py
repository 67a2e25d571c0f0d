"""Kills a run at every record of its journal while its controller lives on, resumes it, and reads
the controller's own log.

    python benchmarks/kills.py [--target TARGET] [--fault STEP=CAUSE] [--from N] [--to N]
        [--json FILE]

The simulated cell is a process of its own, reached over TCP. The process of the run gets SIGKILL at
a record: before the group with it is written, behind that, and when the commands of the group are
sent. Records of one group are written together, so the first two are tried once for each group. The
resumed run has to reach the same goals as one that is not killed, and no command may have been
carried out twice. With --json the kills that have passed are kept, and are not made again by the
next call. Exits with 1 if a kill ends wrong.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from mishaps import Setting, without_lease

from cellwright.engine.model.run_protocol import DriverCommand, JournalRecord
from cellwright.engine.pipelines.execution import RunRequest, TimedOrders, resume_run
from cellwright.engine.pipelines.execution.controllers.reference_controller import serve_controller
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.run_start import JournalLedger
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.plugins import make_driver
from cellwright.engine.ports import DriverSetup
from cellwright.kb.store.journal import Journal
from cellwright.kb.store.run_lease import RunLease, taken_lease

WHEN = ("before", "written", "sent")


class Deadly(JournalLedger):
    """A journal that kills its process at a record, before or behind its group.

    It keeps where each group ends.
    """

    def __init__(self, journal: Journal, lease: RunLease, record: int = 0, when: str = "") -> None:
        super().__init__(journal, lease.run, lease)
        self.record, self.when, self.ends = record, when, list[int]()

    def reached(self) -> bool:
        """Whether the record is written."""
        return bool(self.ends) and self.ends[-1] >= self.record > 0

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records, or die."""
        if self.when == "before" and records[-1].number >= self.record:
            os.kill(os.getpid(), signal.SIGKILL)
        super().append(records)
        self.ends.append(records[-1].number)
        if self.when == "written" and self.reached():
            os.kill(os.getpid(), signal.SIGKILL)


def forked(work: Callable[[], object]) -> int:
    """Run something in a process of its own; its number."""
    child = os.fork()
    if child:
        return child
    try:
        work()
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        os._exit(1)


@contextmanager
def served(setting: Setting, log: Path) -> Iterator[str]:
    """The address of a simulated cell in a process of its own."""
    told, tell = os.pipe()
    options = {"log": str(log), **({"fault": setting.fault} if setting.fault else {})}

    def work() -> None:
        os.dup2(tell, 2)
        serve_controller(DriverSetup(setting.problem, "", 0, 0.0, options), "127.0.0.1", 0)

    child = forked(work)
    os.close(tell)
    with os.fdopen(told) as lines:
        try:
            yield lines.readline().split()[-1]
        finally:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def run(setting: Setting, wanted: RunRequest, record: int = 0, when: str = "") -> list[int]:
    """A run over TCP that may die at a record; else the last numbers of its groups."""
    with taken_lease(wanted.store, wanted.run) as lease, Journal(wanted.store) as journal:
        options = dict(wanted.options)
        setup = DriverSetup(setting.problem, wanted.run, 0, 0.0, options, lease.fence)
        made, ledger = make_driver("external", setup), Deadly(journal, lease, record, when)
        send = made.send

        def sent(commands: Sequence[DriverCommand]) -> None:
            send(commands)
            if when == "sent" and ledger.reached():
                os.kill(os.getpid(), signal.SIGKILL)

        made.send = sent  # type: ignore[method-assign]
        setting.run(wanted, made, ledger, [])
        made.close()
        return ledger.ends


def wanted_in(setting: Setting, folder: Path, address: str) -> RunRequest:
    """A run with its journal in a folder."""
    store, options = str(folder / "runs.db"), {"address": address}
    return without_lease(
        RunRequest(setting.target, driver="external", store=store, options=options), setting.problem
    )


def trial(setting: Setting, record: int, when: str, goals: list[str]) -> tuple[bool, str]:
    """Whether the run was killed before its end, and what is wrong afterwards; nothing if all
    is well.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with served(setting, folder / "cell.log") as address:
            wanted = wanted_in(setting, folder, address)
            _, status = os.waitpid(forked(lambda: run(setting, wanted, record, when)), 0)
            if not os.WIFSIGNALED(status):
                return False, "" if status == 0 else f"the run ended with {status}"
            outcome = folder / "outcome.json"

            def again() -> None:
                ending = resume_run(wanted.store, wanted.run, TimedOrders())
                outcome.write_text(
                    json.dumps([ending.outcome, ending.why, sorted(ending.goals)]), "utf-8"
                )

            if not over(wanted):
                os.waitpid(forked(again), 0)
                if not outcome.is_file():
                    return True, "it could not be resumed"
                said, why, reached = json.loads(outcome.read_text("utf-8"))
                if reached != goals:
                    return True, f"{said}: {why}; {len(reached)} of {len(goals)} goals"
            return True, twice_in(folder / "cell.log")


def over(wanted: RunRequest) -> bool:
    """Whether the journal tells of the end of the run."""
    with Journal(wanted.store) as journal:
        return bool(journal.last(wanted.run, "end"))


def twice_in(log: Path) -> str:
    """Which commands a cell has carried out twice, as its log tells; empty if none."""
    entries = []
    for each in filter(None, log.read_text("utf-8").splitlines()):
        with suppress(ValueError):
            entries.append(json.loads(each))
    twice = [
        n for n, count in Counter(e["ended"] for e in entries if "ended" in e).items() if count > 1
    ]
    return f"commands carried out twice: {twice}" if twice else ""


def unharmed(setting: Setting) -> tuple[list[int], list[str]]:
    """The last numbers of the groups of a run that is not killed, and the goals that it reaches."""
    with tempfile.TemporaryDirectory() as name, served(setting, Path(name) / "cell.log") as address:
        wanted, found = wanted_in(setting, Path(name), address), Path(name) / "ends.json"
        os.waitpid(forked(lambda: found.write_text(json.dumps(run(setting, wanted)), "utf-8")), 0)
        with Journal(wanted.store) as journal:
            end = journal.line(wanted.run, journal.last(wanted.run))
        assert end is not None
        return json.loads(found.read_text("utf-8")), sorted(end.content["goals"])


def main() -> int:
    """Kill at every record, and print what went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--target", default="themse/one")
    parser.add_argument("--fault", default="pick=not_gripped")
    parser.add_argument("--from", dest="first", type=int, default=2)
    parser.add_argument("--to", dest="last", type=int)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    kept = asked.json is not None and asked.json.is_file()
    passed = set(json.loads(asked.json.read_text("utf-8"))) if kept else set[str]()
    problem = problem_of(asked.target)
    ready = first_plan(problem)
    assert isinstance(ready, ReadyPlan), ready
    setting = Setting(asked.target, asked.fault, problem, ready)
    ends, goals = unharmed(setting)
    print(f"{ends[-1]} records in {len(ends)} groups, {len(goals)} goals", flush=True)
    counted, wrong = Counter[str](), 0
    for end in (each for each in ends[1:] if asked.first <= each <= (asked.last or ends[-1])):
        for when in (each for each in WHEN if f"{end} {each}" not in passed):
            killed, found = trial(setting, end, when, goals)
            counted[when if killed else "not killed"] += 1
            wrong += bool(found)
            if found:
                print(f"  at record {end}, {when}: {found}", flush=True)
            passed |= set() if found else {f"{end} {when}"}
            if asked.json:
                asked.json.write_text(json.dumps(sorted(passed)) + "\n", "utf-8")
    print(f"kills: {dict(counted)}; {len(passed)} have passed so far; {wrong} ended wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
