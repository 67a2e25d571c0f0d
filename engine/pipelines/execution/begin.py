"""Begins a run: the plan, the driver, the journal, and all that they need of each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

from engine.model.execution import VERSION, Finish, Record, RecordKind
from engine.model.outcome import Outcome
from engine.pipelines.execution.compiling import situation_of
from engine.pipelines.execution.orders import Orders
from engine.pipelines.execution.planned import Ready, first
from engine.pipelines.execution.recorder import Recorder, Watcher
from engine.pipelines.execution.running import Execution
from engine.pipelines.simulation import World
from engine.pipelines.simulator.driver import fault_base
from engine.plugins import driver
from engine.ports import Driver, DriverSetup
from engine.stages.planning import Limits
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.problem import Problem
from kb.store.journal import Journal, Line


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be run and how. `target` and the texts are kept in the journal, so that the run can be resumed."""

    target: str
    goals: str = ""
    command: str = ""
    driver: str = "sim"
    store: str = ""
    run: str = ""
    seed: int = 0
    factor: float = 0.0
    options: Mapping[str, str] = field(default_factory=dict)
    approve: bool = False


class Ledger:
    """The journal of one run, in a database."""

    def __init__(self, journal: Journal, run: str) -> None:
        self.journal, self.run = journal, run

    def append(self, records: Sequence[Record]) -> None:
        """Append records; they are on the disk when this returns. Raises `JournalFailure`."""
        self.journal.append(self.run, [Line(r.number, r.at_ms, r.kind.value, r.content) for r in records])


def begin(
    wanted: Wanted,
    problem: Problem,
    orders: Orders,
    watchers: Sequence[Watcher] = (),
    limits: Limits = Limits(),
    outcome: Outcome | None = None,
) -> Finish | Outcome:
    """Run a problem to its end under a name that `named` has given; why there is no plan, if there is none.

    Raises `InvalidInput`.
    """
    found = first(problem, limits, outcome)
    if not isinstance(found, Ready):
        return found
    with Journal(wanted.store) as journal:
        run = wanted.run
        setup = DriverSetup(problem, run, wanted.seed, wanted.factor, wanted.options)
        made = driver(wanted.driver, setup)
        try:
            return _executed(wanted, problem, found, made, journal, run, orders, watchers, limits)
        finally:
            made.close()


def _executed(
    wanted: Wanted,
    problem: Problem,
    ready: Ready,
    made: Driver,
    journal: Journal,
    run: str,
    orders: Orders,
    watchers: Sequence[Watcher],
    limits: Limits,
) -> Finish:
    recorder = Recorder(Ledger(journal, run), made.now_ms, watchers)
    recorder.note(RecordKind.RUN, **document(wanted, problem))
    execution = Execution(run, problem, made, recorder, orders, fault_base(problem), limits)
    world = World.of(problem, situation_of(problem).state)
    return execution.start(ready, world, wanted.approve)


def document(wanted: Wanted, problem: Problem) -> dict[str, object]:
    """What a run was begun with, as the journal has it."""
    return {
        "target": wanted.target,
        "problem": problem.name,
        "domain": problem.domain.name,
        "goals": wanted.goals,
        "command": wanted.command,
        "driver": wanted.driver,
        "seed": wanted.seed,
        "factor": wanted.factor,
        "options": dict(wanted.options),
        "version": VERSION,
    }


def named(wanted: Wanted, problem: Problem) -> str:
    """The name of a new run: as asked for, or the problem's with the next number. Raises `InvalidInput` for one that is taken."""
    with Journal(wanted.store) as journal:
        return _named(journal, wanted, problem)


def _named(journal: Journal, wanted: Wanted, problem: Problem) -> str:
    begun = datetime.now(UTC).isoformat(timespec="seconds")
    about = document(wanted, problem)
    if wanted.run:
        if journal.begin(wanted.run, begun, about):
            return wanted.run
        hint = f"give another name with --name, or go on with it: cellwright resume {wanted.run}"
        raise InvalidInput(
            [Diagnostic(Source("--name"), "K420", f"there is a run {wanted.run} already", hint)]
        )
    number = 1
    while not journal.begin(f"{problem.name}-{number}", begun, about):
        number += 1
    return f"{problem.name}-{number}"
