"""Begins a run: the plan, the driver, the journal, and all that they need of each other."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.execution import VERSION, Finish, Record, RecordKind
from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.schedule import Timetable
from cellwright.engine.pipelines.execution.checkpoints import past_of
from cellwright.engine.pipelines.execution.compiling import situation_of
from cellwright.engine.pipelines.execution.faults import refuse_unknown, settled
from cellwright.engine.pipelines.execution.inspector import datums_first, measured_in
from cellwright.engine.pipelines.execution.knowledge import added_knowledge, with_knowledge
from cellwright.engine.pipelines.execution.orders import Orders
from cellwright.engine.pipelines.execution.planned import Ready, first, ready
from cellwright.engine.pipelines.execution.recorder import Recorder, Watcher
from cellwright.engine.pipelines.execution.resuming import Past
from cellwright.engine.pipelines.execution.running import Execution
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.past import reading_past
from cellwright.engine.pipelines.simulation import Memory, SymbolicWorld
from cellwright.engine.pipelines.simulator.driver import fault_base
from cellwright.engine.pipelines.verdicts.spoiling import spoilt_in
from cellwright.engine.plugins import driver
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.journal import Journal, Line

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.paths import Paths

LOGGED = ("sim", "mujoco")  # drivers that can be where they were before, by a log
OVER = ("reached", "partly", "aborted")  # endings after which there is nothing to resume


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
    motion: bool = False


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
    table: Timetable | None = None,
    scope: Scope | None = None,
    paths: "Paths | None" = None,
) -> Finish | Outcome:
    """Run a problem to its end under a name that `named` has given; why there is no plan, if there is none.

    `outcome` is a plan that is known already, `table` one with its starts; `scope` says for which of the goals. With `paths`, each
    step is looked at before it is sent, and has to move. Raises `InvalidInput`.
    """
    scope = scope or Scope(problem)
    if table is not None:
        found: Ready | Outcome = ready(scope.problem, table.plan, table.starts, 0)
    else:
        found = first(problem, limits, outcome, wanted.store)
    if not isinstance(found, Ready):
        return found
    with Journal(wanted.store) as journal:
        run, base = wanted.run, fault_base(problem)
        if wanted.options.get("fault"):
            faults = settled(wanted.options["fault"], found, base)
            wanted = replace(wanted, options={**wanted.options, "fault": faults})
        setup = DriverSetup(problem, run, wanted.seed, wanted.factor, wanted.options)
        made = driver(wanted.driver, setup)
        try:
            recorder = Recorder(Ledger(journal, run), made.now_ms, watchers)
            more = added_knowledge(_problem(wanted.target, wanted.goals, wanted.command), problem)
            recorder.note(RecordKind.RUN, **document(wanted, problem), **more)
            execution = Execution(run, problem, made, recorder, orders, base, limits, paths=paths)
            found, scope = datums_first(found, scope)
            world = SymbolicWorld.of(scope.problem, situation_of(problem).state)
            return _cleared(wanted, execution.start(found, world, wanted.approve, scope))
        finally:
            made.close()


def resume(
    store: str,
    run: str,
    orders: Orders,
    watchers: Sequence[Watcher] = (),
    limits: Limits = Limits(),
    factor: float | None = None,
) -> Finish:
    """Go on with a run from its journal; with another `factor` of real time, if one is given.

    Raises `InvalidInput` if there is no such run, or if it is over.
    """
    with Journal(store) as journal:
        about = journal.known(run).document
        problem = _problem(*(str(about.get(each, "")) for each in ("target", "goals", "command")))
        first_line = journal.line(run, 1)
        with reading_past(store, run):
            problem = with_knowledge(problem, first_line.content if first_line else {})
        base = fault_base(problem)
        start = SymbolicWorld.of(problem, situation_of(problem).state)
        with reading_past(store, run):
            past = past_of(journal, run, Past(start, Scope(problem), Memory.of(base)))
            past.measured = measured_in(journal.lines(run, kinds=(RecordKind.RESULT.value,)))
            worlds = journal.lines(run, kinds=(RecordKind.WORLD.value,))
            past.spoilt = spoilt_in((line.content, line.at_ms) for line in worlds)
        if past.plan is None or past.ended in OVER:
            said = f"the run {run} is over: {past.ended}" if past.ended else f"the run {run} never had a plan"
            raise InvalidInput([Diagnostic(Source(run), "K421", said, "begin another run")])
        setup = setup_of({**about, **past.run}, problem, run)
        setup = setup if factor is None else replace(setup, factor=factor)
        made = driver(str(about["driver"]), setup)
        try:
            recorder = Recorder(Ledger(journal, run), made.now_ms, watchers, past.last)
            paths = _paths(about, past.whole, store) if about.get("motion") else None
            execution = Execution(run, past.whole, made, recorder, orders, base, limits, paths=paths)
            ending = execution.resume(past)
            return _cleared(Wanted("", store=store, run=run, options=about["options"]), ending)
        finally:
            made.close()


def followed(store: str, run: str, factor: float | None = None) -> tuple[float, Sequence[Record]]:
    """How fast a run goes on, and its records from its last plan on, for who looks on. Raises `InvalidInput` if there is none."""
    with Journal(store) as journal:
        pace = float(journal.known(run).document["factor"]) if factor is None else factor
        last = journal.last(run, RecordKind.PLAN.value)
        lines = journal.lines(run, last - 1) if pace and last else ()
        return pace, [Record(line.number, line.at_ms, RecordKind(line.kind), line.content) for line in lines]


def _problem(target: str, goals: str, command: str) -> Problem:
    from cellwright.engine.pipelines.planning import problem_of

    return problem_of(target, goals, command)


def _paths(about: Mapping[str, Any], problem: Problem, store: str) -> "Paths":
    """What the arm of a run with motion can do."""
    from cellwright.engine.pipelines.execution.paths import Paths  # it needs numpy, and most runs no geometry
    from cellwright.engine.pipelines.poses.planning import known_ways
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of

    cell = cell_of(str(about["target"]))
    ways = known_ways(problem, cell, geometry_backend(), store)
    return Paths(problem, cell, int(about["seed"]), ways)


def setup_of(about: Mapping[str, Any], problem: Problem, run: str) -> DriverSetup:
    """What the driver of a run was made for."""
    return DriverSetup(problem, run, int(about["seed"]), float(about["factor"]), dict(about["options"]))


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
        **({"motion": True} if wanted.motion else {}),
        "version": VERSION,
    }


def named(wanted: Wanted, problem: Problem) -> Wanted:
    """The same under the name of a new run: as asked for, or the problem's with the next number.

    A simulated cell gets a log beside the journal, so that the run can be resumed. Raises `InvalidInput` for a name that is
    taken, and for faults that no plan can have: before any time goes into a plan.
    """
    refuse_unknown(wanted.options.get("fault", ""), fault_base(problem))
    with Journal(wanted.store) as journal:
        begun = datetime.now(UTC).isoformat(timespec="seconds")
        for run in [wanted.run] if wanted.run else (f"{problem.name}-{n}" for n in itertools.count(1)):
            made = replace(wanted, run=run, options=_logged(wanted, run))
            if journal.begin(run, begun, document(made, problem)):
                return made
    hint = f"give another name with --name, or go on with it: cellwright resume {wanted.run}"
    raise InvalidInput([Diagnostic(Source("--name"), "K421", f"there is a run {wanted.run} already", hint)])


@contextmanager
def listed(wanted: Wanted, problem: Problem) -> Iterator[Wanted]:
    """As `named`, for as long as the run is begun; one that is refused, or that has no plan, is not listed afterwards."""
    made = named(wanted, problem)
    try:
        yield made
    finally:
        with suppress(InvalidInput), Journal(made.store) as journal:
            journal.withdraw(made.run)


def _cleared(wanted: Wanted, ending: Finish) -> Finish:
    """The ending; the log that a simulated cell got by itself is not needed any more when the run is over."""
    if ending.outcome in OVER and wanted.options.get("log") == _log(wanted.store, wanted.run):
        Path(wanted.options["log"]).unlink(missing_ok=True)
    return ending


def _log(store: str, run: str) -> str:
    return f"{store}.{run}.sim.jsonl"


def _logged(wanted: Wanted, run: str) -> Mapping[str, str]:
    """The options of the driver; a simulator without a log writes one beside a journal that is a file."""
    if wanted.driver not in LOGGED or "log" in wanted.options or "://" in wanted.store:
        return wanted.options
    return {**wanted.options, "log": _log(wanted.store, run)}
