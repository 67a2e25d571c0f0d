"""Start of a run: plan, driver, journal, ordered faults, and facts known beside the problem."""

import getpass
import itertools
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.run_protocol import PROTOCOL_VERSION, Finish, JournalRecord, RecordKind
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.model.start_rules import NO_RULES, StartRules
from cellwright.engine.pipelines import motion as motion_room
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.execution.checkpoints import past_of
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import (
    ReadyPlan,
    compile_ready_plan,
    first_plan,
)
from cellwright.engine.pipelines.execution.inspector import datums_first, measured_in
from cellwright.engine.pipelines.execution.operator_orders import OrderSource
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.run_control import RunExecution
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_journal import Recorder, Watcher, reading_past
from cellwright.engine.pipelines.execution.run_resumption import PastRun
from cellwright.engine.pipelines.inspection.spoilt_values import spoilt_in
from cellwright.engine.pipelines.recovery import KeptHistory, SymbolicWorld
from cellwright.engine.pipelines.simulators import exceptions_of_cause
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.engine.plugins import geometry_backend, make_driver
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint, unknown_name
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.numbers import is_count
from cellwright.kb.store.journal import Journal, JournalLine
from cellwright.kb.terms import Function

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.run_motions import RunPaths

FAULT_OPTION = Source("--fault")


def settle_faults(text: str, ready: ReadyPlan, base: FaultModel | None) -> str:
    """Faults as a simulator reads them: STEP#TIME=CAUSE; a number is a step of the plan. Raises
    `InvalidInput`.
    """
    return "; ".join(
        _settle_fault(fault.strip(), ready, base) for fault in text.split(";") if fault.strip()
    )


def refuse_unknown(text: str, base: FaultModel | None) -> None:
    """Refuse what is wrong with faults whatever the plan will be. Raises `InvalidInput`."""
    for fault in filter(None, (part.strip() for part in text.split(";"))):
        _split_fault(fault, base)


def _split_fault(text: str, base: FaultModel | None) -> tuple[str, str, str]:
    """The step of a fault, its cause, and its exception or nothing."""
    named, equals, rest = text.rpartition("=")
    cause, _, exception = rest.partition("@")
    named, cause = named.strip(), cause.strip()
    if not equals or not named or not cause:
        raise _fault_error(
            f"'{text}' is no fault", "write STEP=CAUSE: 3=not_gripped, or pick#2=arm_offset"
        )
    if base is None:
        raise _fault_error("the domain has no fault base", "write a faults.yaml beside it")
    if cause not in base.causes:
        raise InvalidInput([_unknown_cause(cause, base, re.split(r"[#(]", named)[0].strip())])
    return named, cause, exception


def _settle_fault(text: str, ready: ReadyPlan, base: FaultModel | None) -> str:
    named, cause, exception = _split_fault(text, base)
    assert base is not None
    action, _, time = named.partition("#")
    steps = [
        step.operator for step in sorted(ready.plan.steps, key=lambda s: (ready.starts[s.id], s.id))
    ]
    named_steps = _steps_named(action.strip(), ready, steps)
    ways = [
        shown_exception
        for step in named_steps
        for shown_exception in exceptions_of_cause(base, step, cause)
    ]
    if not ways:
        where = sorted(
            {str(e.operator) for e in base.exceptions.values() if cause in e.counts and e.operator}
        )
        raise _fault_error(
            f"{cause} does not show at {action.strip()}", f"it shows at: {', '.join(where)}"
        )
    instance = str(named_steps[0]) if is_count(action.strip()) else action.strip()
    return f"{instance}{'#' + time if time else ''}={cause}{'@' + exception if exception else ''}"


def _unknown_cause(cause: str, base: FaultModel, operator: str) -> Diagnostic:
    """No such cause: the nearest name, or those that can show at steps of the operator, if one
    is named.
    """
    diagnostic = unknown_name("cause", cause, base.causes, FAULT_OPTION)
    shown = {
        name
        for known_exception in base.exceptions.values()
        if known_exception.operator and known_exception.operator.name == operator
        for name in known_exception.counts
    }
    if nearest_hint(cause, base.causes) or not shown:
        return diagnostic
    return replace(diagnostic, hint=f"at {operator}: {', '.join(sorted(shown))}")


def _steps_named(action: str, ready: ReadyPlan, steps: list[Function]) -> list[Function]:
    """The steps that a fault names: one by its number or as it is written, or all of an
    operator.
    """
    if is_count(action):
        named_steps = [step.operator for step in ready.plan.steps if int(step.id) == int(action)]
        hint = f"the plan has steps 1 to {len(steps)}"
    else:
        plain = action.replace(" ", "")
        named_steps = [step for step in steps if plain in (step.name, str(step).replace(" ", ""))]
        hint = nearest_hint(
            action, list(dict.fromkeys(step.name for step in steps))
        ) or _operators_text(steps)
    if not named_steps:
        raise _fault_error(f"the plan has no step {action}", hint)
    return named_steps


def _operators_text(steps: Iterable[Function]) -> str:
    names = list(dict.fromkeys(step.name for step in steps))
    return f"it has: {', '.join(names)}"


def _fault_error(message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(FAULT_OPTION, "K421", message, hint)])


FACTS, TIMES = "facts", "times"


def added_knowledge(asked: Problem, known: Problem) -> dict[str, Any]:
    """What is known of a problem beside what was told, for the journal; nothing if that is all."""
    before = set(asked.statics)
    facts = [str(fact) for fact in known.statics if fact not in before]
    times = [
        [str(step), lasts]
        for step, lasts in known.durations.items()
        if asked.durations.get(step) != lasts
    ]
    return {**({FACTS: facts} if facts else {}), **({TIMES: times} if times else {})}


def with_knowledge(problem: Problem, entry: Mapping[str, Any]) -> Problem:
    """The problem with what a journal's entry knows beside it."""
    facts = tuple(map(read_ground_atom, entry.get(FACTS, ())))
    times = {read_ground_atom(step): int(lasts) for step, lasts in entry.get(TIMES, ())}
    if not facts and not times:
        return problem
    return replace(
        problem, statics=(*problem.statics, *facts), durations={**problem.durations, **times}
    )


LOGGED_DRIVERS = ("sim", "mujoco")  # drivers that can be where they were before, by a log
FINAL_OUTCOMES = ("reached", "partly", "aborted")  # endings after which there is nothing to resume


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What is to be run and how.

    `target` and the texts are kept in the journal, so that the run can be resumed.
    """

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


class JournalLedger:
    """The journal of one run, in a database."""

    def __init__(self, journal: Journal, run: str) -> None:
        self.journal, self.run = journal, run

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records; they are on the disk when this returns. Raises `JournalFailure`."""
        self.journal.append(
            self.run, [JournalLine(r.number, r.at_ms, r.kind.value, r.content) for r in records]
        )


def begin_run(
    request: RunRequest,
    problem: Problem,
    orders: OrderSource,
    watchers: Sequence[Watcher] = (),
    limits: SearchLimits = SearchLimits(),
    outcome: Outcome | None = None,
    table: Timetable | None = None,
    scope: RunScope | None = None,
    paths: "RunPaths | None" = None,
    as_read: Problem | None = None,
    rules: StartRules = NO_RULES,
) -> Finish | Outcome:
    """Run a problem to its end under a name that `named` has given; why there is no plan, if there
    is none.

    `outcome` is a plan that is known already, `table` one with its starts; `scope` says for which
    of the goals. With `paths`, each step is looked at before it is sent, and has to move. `as_read`
    is the problem as its files have it; they are read again if it is not given. The steps of a
    `table` begin by the `rules` of a policy, if it has one. Raises `InvalidInput`.
    """
    scope = scope or RunScope(problem)
    if table is not None:
        plan_or_outcome: ReadyPlan | Outcome = compile_ready_plan(
            scope.problem, table.plan, table.starts, 0, rules=rules
        )
    else:
        plan_or_outcome = first_plan(problem, limits, outcome, request.store)
    if not isinstance(plan_or_outcome, ReadyPlan):
        return plan_or_outcome
    with Journal(request.store) as journal:
        run, base = request.run, fault_base(problem)
        if request.options.get("fault"):
            faults = settle_faults(request.options["fault"], plan_or_outcome, base)
            request = replace(request, options={**request.options, "fault": faults})
        setup = DriverSetup(problem, run, request.seed, request.factor, request.options)
        run_driver = make_driver(request.driver, setup)
        try:
            recorder = Recorder(JournalLedger(journal, run), run_driver.now_ms, watchers)
            as_read = as_read or _read_problem(request.target, request.goals, request.command)
            more = added_knowledge(as_read, problem)
            recorder.note(RecordKind.RUN, **run_document(request, problem), **more)
            execution = RunExecution(
                run, problem, run_driver, recorder, orders, base, limits, paths=paths
            )
            plan_or_outcome, scope = datums_first(plan_or_outcome, scope)
            world = SymbolicWorld.of(scope.problem, initial_situation(problem).state)
            return _clear_log(
                request, execution.start(plan_or_outcome, world, request.approve, scope)
            )
        finally:
            run_driver.close()


def resume_run(
    store: str,
    run: str,
    orders: OrderSource,
    watchers: Sequence[Watcher] = (),
    limits: SearchLimits = SearchLimits(),
    factor: float | None = None,
    unchained: bool = False,
) -> Finish:
    """Go on with a run from its journal; with another `factor` of real time, if one is given.

    The journal is proved whole before anything is asked of the driver; one that an older version
    began has no chain, and is taken if `unchained` says so. Raises `InvalidInput` if there is no
    such run, if it is over, or if its journal is damaged.
    """
    with Journal(store) as journal:
        about = journal.known(run).document
        journal.require_whole(run, unchained)
        problem = _read_problem(
            *(str(about.get(key, "")) for key in ("target", "goals", "command"))
        )
        first_line = journal.line(run, 1)
        with reading_past(store, run):
            problem = with_knowledge(problem, first_line.content if first_line else {})
        base = fault_base(problem)
        start = SymbolicWorld.of(problem, initial_situation(problem).state)
        with reading_past(store, run):
            past = past_of(journal, run, PastRun(start, RunScope(problem), KeptHistory.of(base)))
            past.measured = measured_in(journal.lines(run, kinds=(RecordKind.RESULT.value,)))
            worlds = journal.lines(run, kinds=(RecordKind.WORLD.value,))
            past.spoilt = spoilt_in((line.content, line.at_ms) for line in worlds)
        if past.plan is None or past.ended in FINAL_OUTCOMES:
            reason = (
                f"the run {run} is over: {past.ended}"
                if past.ended
                else f"the run {run} never had a plan"
            )
            raise InvalidInput([Diagnostic(Source(run), "K421", reason, "begin another run")])
        setup = setup_of({**about, **past.run}, problem, run)
        setup = setup if factor is None else replace(setup, factor=factor)
        run_driver = make_driver(str(about["driver"]), setup)
        try:
            recorder = Recorder(JournalLedger(journal, run), run_driver.now_ms, watchers, past.last)
            paths = _run_paths(about, past.whole, store) if about.get("motion") else None
            execution = RunExecution(
                run, past.whole, run_driver, recorder, orders, base, limits, paths=paths
            )
            ending = execution.resume(past)
            return _clear_log(
                RunRequest("", store=store, run=run, options=about["options"]), ending
            )
        finally:
            run_driver.close()


def follow_run(
    store: str, run: str, factor: float | None = None
) -> tuple[float, Sequence[JournalRecord]]:
    """How fast a run goes on, and its records from its last plan on, for who looks on.

    Raises `InvalidInput` if there is none.
    """
    with Journal(store) as journal:
        begun = journal.known(run)
        journal.require_whole(run, unchained=True)
        pace = float(begun.document["factor"]) if factor is None else factor
        last = journal.last(run, RecordKind.PLAN.value)
        lines = journal.lines(run, last - 1) if pace and last else ()
        return pace, [
            JournalRecord(line.number, line.at_ms, RecordKind(line.kind), line.content)
            for line in lines
        ]


def _read_problem(target: str, goals: str, command: str) -> Problem:
    return planning.problem_of(target, goals, command)


def _run_paths(about: Mapping[str, Any], problem: Problem, store: str) -> "RunPaths":
    """What the arm of a run with motion can do."""
    from cellwright.engine.pipelines.execution.run_motions import (
        RunPaths,  # it needs numpy, and most runs no geometry
    )

    cell = loader.cell_of(str(about["target"]))
    ways = motion_room.known_ways(problem, cell, geometry_backend(), store)
    return RunPaths(problem, cell, int(about["seed"]), ways)


def setup_of(about: Mapping[str, Any], problem: Problem, run: str) -> DriverSetup:
    """What the driver of a run was made for."""
    return DriverSetup(
        problem, run, int(about["seed"]), float(about["factor"]), dict(about["options"])
    )


def run_document(request: RunRequest, problem: Problem) -> dict[str, object]:
    """What a run was begun with, as the journal has it."""
    return {
        "target": request.target,
        "problem": problem.name,
        "domain": problem.domain.name,
        "goals": request.goals,
        "command": request.command,
        "driver": request.driver,
        "seed": request.seed,
        "factor": request.factor,
        "options": dict(request.options),
        **({"motion": True} if request.motion else {}),
        "version": PROTOCOL_VERSION,
    }


def name_run(request: RunRequest, problem: Problem) -> RunRequest:
    """The same under the name of a new run: as asked for, or the problem's with the next number.

    A simulated cell gets a log beside the journal, so that the run can be resumed. Raises
    `InvalidInput` for a name that is taken, and for faults that no plan can have: before any time
    goes into a plan.
    """
    refuse_unknown(request.options.get("fault", ""), fault_base(problem))
    with Journal(request.store) as journal:
        begun = datetime.now(UTC).isoformat(timespec="seconds")
        for run in (
            [request.run] if request.run else (f"{problem.name}-{n}" for n in itertools.count(1))
        ):
            named_request = replace(request, run=run, options=_with_log(request, run))
            document = {**run_document(named_request, problem), "account": account_name()}
            if journal.begin(run, begun, document):
                return named_request
    hint = f"give another name with --name, or go on with it: cellwright resume {request.run}"
    raise InvalidInput(
        [Diagnostic(Source("--name"), "K421", f"there is a run {request.run} already", hint)]
    )


def account_name() -> str:
    """The account that this process works for, and its machine."""
    try:
        name = getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        name = str(os.getuid())
    return f"{name}@{platform.node()}"


@contextmanager
def list_run(request: RunRequest, problem: Problem) -> Iterator[RunRequest]:
    """As `named`, for as long as the run is begun; one that is refused, or that has no plan, is
    not listed afterwards.
    """
    named_request = name_run(request, problem)
    try:
        yield named_request
    finally:
        with suppress(InvalidInput), Journal(named_request.store) as journal:
            journal.withdraw(named_request.run)


def _clear_log(request: RunRequest, ending: Finish) -> Finish:
    """The ending; the log that a simulated cell got by itself is not needed any more when the
    run is over.
    """
    if ending.outcome in FINAL_OUTCOMES and request.options.get("log") == _log_file(
        request.store, request.run
    ):
        Path(request.options["log"]).unlink(missing_ok=True)
    return ending


def _log_file(store: str, run: str) -> str:
    return f"{store}.{run}.sim.jsonl"


def _with_log(request: RunRequest, run: str) -> Mapping[str, str]:
    """The options of the driver; a simulator without a log writes one beside a journal that is
    a file.
    """
    if request.driver not in LOGGED_DRIVERS or "log" in request.options or "://" in request.store:
        return request.options
    return {**request.options, "log": _log_file(request.store, run)}
