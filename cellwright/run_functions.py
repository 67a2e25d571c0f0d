"""Runs: plans carried out, watched, given orders, resumed; and what they measured."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import fspath
from typing import TYPE_CHECKING, Any, Literal

from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.run_protocol import Finish
from cellwright.engine.pipelines import execution, planning
from cellwright.kb import store as kb_store
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.library_base import Answer, Name, Told, load
from cellwright.plan_functions import plan_motions_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.outcome import Outcome
    from cellwright.engine.model.run_protocol import JournalRecord
    from cellwright.engine.pipelines.execution import RunRequest
    from cellwright.engine.pipelines.execution.run_results import Told as Measured
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb.model.planning_problem import Problem
    from cellwright.kb.store.journal import Begun

Watch = Callable[["JournalRecord"], None]
OrderName = Literal[
    "stop",
    "interrupt",
    "continue",
    "approve",
    "abort",
    "skip",
    "retry",
    "back",
    "correct",
    "answer",
    "add",
]


@dataclass(frozen=True, repr=False)
class Ran(Answer):
    """How a run ended; or why there was no plan to begin with."""

    ending: "Finish | Outcome"
    store: str = field(repr=False)

    @property
    def finish(self) -> "Finish | None":
        """The end of the run: its name, goals, what was given up, times, and the story of each
        exception. None without a plan.
        """
        return self.ending if isinstance(self.ending, Finish) else None

    @property
    def run(self) -> str:
        """The name of the run, by which it is resumed, told and looked up; empty if it did not
        begin.
        """
        return self.finish.run if self.finish else ""

    @property
    def status(self) -> str:
        """reached, partly, stopped, aborted or paused; infeasible or gave up without a plan."""
        return (
            self.ending.outcome
            if isinstance(self.ending, Finish)
            else report.outcome_status(self.ending)
        )

    def data(self) -> Mapping[str, Any]:
        """The ending as data."""
        return (
            report.ending_entry(self.finish)
            if self.finish
            else {"reason": getattr(self.ending, "reason", "")}
        )

    def _renderable(self) -> "RenderableType":
        if self.finish:
            return report.ending_text(self.finish, self.store)
        return f"No plan: {getattr(self.ending, 'reason', '')}."


def run(
    target: Name,
    *,
    goals: str = "",
    command: str = "",
    driver: str = "sim",
    faults: Sequence[str] = (),
    options: Mapping[str, str] | None = None,
    store: Name = "",
    name: str = "",
    factor: float = 0.0,
    motion: bool = False,
    watch: Watch | None = None,
    expansions: int = 1_000_000,
    seed: int = 0,
) -> Ran:
    """Plan, carry the plan out, diagnose and repair what goes wrong, and go on until the goals are
    reached.

    `faults` are simulated ("pick#3=not_gripped"). `store` keeps the journal; without it, the user's
    own journal does. `factor` is the share of real time that simulated time takes. `watch` is
    called with each record when it is on the disk. Other processes and threads tell the run what to
    do (`tell`). Raises `InvalidInput`.
    """
    from cellwright.engine.stages.planning import SearchLimits

    problem, where = load(target, goals, command), fspath(store) or kb_store.default_store()
    given = dict(options or {}) | ({"fault": "; ".join(faults)} if faults else {})
    wanted = execution.RunRequest(
        fspath(target), goals, command, driver, where, name, seed, factor, given
    )
    with execution.list_run(wanted, problem) as entered:
        return Ran(
            _begin_run(entered, problem, motion, watch, SearchLimits(expansions, seed=seed)), where
        )


def _begin_run(
    wanted: "RunRequest",
    problem: "Problem",
    motion: bool,
    watch: Watch | None,
    limits: "SearchLimits",
) -> "Finish | Outcome":
    table, scope, as_read = None, None, problem
    if motion:
        moving = plan_motions_of(
            problem,
            lambda each: planning.plan_for_objective(each, limits),
            wanted.seed,
            wanted.store,
        )
        table, scope = moving.run.timetable, execution.RunScope(moving.problem, moving.given_up)
        problem = replace(moving.problem, goal=problem.goal, chains=problem.chains)
        if table is None:
            return moving.run.outcome
    with execution.OrderChannel(wanted.run, wanted.store) as channel:
        watchers = [channel.watch, *([watch] if watch else [])]
        return execution.begin_run(
            wanted, problem, channel, watchers, limits, table=table, scope=scope, as_read=as_read
        )


def resume(
    run: str,
    *,
    store: Name = "",
    watch: Watch | None = None,
    expansions: int = 1_000_000,
    seed: int = 0,
    unchained: bool = False,
) -> Ran:
    """Go on with a run after a stop, a pause or a crash; no command is carried out twice.

    The journal is proved whole before anything is sent. One that version 0.2.0 began has no digests
    to prove it by, and is taken if `unchained`. Raises `InvalidInput`.
    """
    from cellwright.engine.stages.planning import SearchLimits

    where = fspath(store) or kb_store.default_store()
    with execution.OrderChannel(run, where) as channel:
        watchers = [channel.watch, *([watch] if watch else [])]
        return Ran(
            execution.resume_run(
                where,
                run,
                channel,
                watchers,
                SearchLimits(expansions, seed=seed),
                unchained=unchained,
            ),
            where,
        )


def tell(run: str, order: OrderName, text: str = "", *, store: Name = "") -> Mapping[str, Any]:
    """Give an order to a run that goes on in another process or thread; returns how it stands.

    `text` is the step of skip and back, the facts of correct, the answer of answer and the command
    of add. Raises `InvalidInput` if nobody carries the run out, or if it refuses the order.
    """
    state = execution.tell_run(run, order, text, fspath(store))
    if why := state.get("refused"):
        raise InvalidInput([Diagnostic(Source(run), "K421", f"{order} is refused: {why}")])
    return state


def runs(*, store: Name = "") -> "tuple[Begun, ...]":
    """The runs of a store: their names, when they began, and what was asked."""
    return execution.runs_in(fspath(store) or kb_store.default_store())


def results(run: str, *, store: Name = "") -> "Told[Measured]":
    """What a run has measured, with verdicts, and the history of each object.

    Raises `InvalidInput` for an unknown run.
    """

    def content(told: "Measured") -> Mapping[str, Any]:
        return interop.results_entry(told.results) | (
            {} if told.survey is None else {"survey": report.survey_entry(told.survey)}
        )

    def shown(told: "Measured") -> "RenderableType":
        more = [] if told.survey is None else ["", report.survey_text(told.survey)]
        return rich_parts.Group(report.results_text(told.results, told.subjects), *more)

    return Told(
        execution.survey_of(fspath(store) or kb_store.default_store(), run), "ok", content, shown
    )
