"""Runs: plans carried out, watched, told what to do, resumed; and what they measured."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import fspath
from typing import TYPE_CHECKING, Any, Literal

from cellwright.answers import Answer, Told
from cellwright.plans import moved
from cellwright.requests import Name, load

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.execution import Finish, Record
    from cellwright.engine.model.outcome import Outcome
    from cellwright.engine.pipelines.execution import Wanted
    from cellwright.engine.pipelines.results import Told as Measured
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.model.problem import Problem
    from cellwright.kb.store.journal import Begun

Watch = Callable[["Record"], None]
OrderName = Literal[
    "stop", "interrupt", "continue", "approve", "abort", "skip", "retry", "back", "correct", "answer", "add"
]


@dataclass(frozen=True, repr=False)
class Ran(Answer):
    """How a run ended; or why there was no plan to begin with."""

    ending: "Finish | Outcome"
    store: str = field(repr=False)

    @property
    def finish(self) -> "Finish | None":
        """The end of the run: its name, goals, what was given up, times, and the story of each exception. None without a plan."""
        from cellwright.engine.model.execution import Finish

        return self.ending if isinstance(self.ending, Finish) else None

    @property
    def run(self) -> str:
        """The name of the run, by which it is resumed, told and looked up; empty if it did not begin."""
        return self.finish.run if self.finish else ""

    @property
    def status(self) -> str:
        """reached, partly, stopped, aborted or paused; infeasible or gave up without a plan."""
        from cellwright.engine.formats.report import json
        from cellwright.engine.model.execution import Finish

        return self.ending.outcome if isinstance(self.ending, Finish) else json.status(self.ending)

    def data(self) -> Mapping[str, Any]:
        """The ending as data."""
        from cellwright.engine.formats.report import execution

        return execution.entry(self.finish) if self.finish else {"reason": getattr(self.ending, "reason", "")}

    def _renderable(self) -> "RenderableType":
        from cellwright.engine.formats.report import execution

        if self.finish:
            return execution.text(self.finish, self.store)
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
    """Plan, carry the plan out, diagnose and repair what goes wrong, and go on until the goals are reached.

    `faults` are simulated ("pick#3=not_gripped"). `store` keeps the journal; without it, the user's own journal does.
    `factor` is the share of real time that simulated time takes. `watch` is called with each record when it is on the disk.
    Other processes and threads tell the run what to do (`tell`). Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.execution import Wanted, listed
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.store.own import default_store

    problem, where = load(target, goals, command), fspath(store) or default_store()
    given = dict(options or {}) | ({"fault": "; ".join(faults)} if faults else {})
    wanted = Wanted(fspath(target), goals, command, driver, where, name, seed, factor, given)
    with listed(wanted, problem) as entered:
        return Ran(_begun(entered, problem, motion, watch, Limits(expansions, seed=seed)), where)


def _begun(
    wanted: "Wanted", problem: "Problem", motion: bool, watch: Watch | None, limits: "Limits"
) -> "Finish | Outcome":
    from cellwright.engine.pipelines.execution import Scope, begin
    from cellwright.engine.pipelines.execution.channel import Channel

    table = scope = None
    if motion:
        from cellwright.engine.pipelines.objective import plan

        moving = moved(wanted.target, problem, lambda each: plan(each, limits), wanted.seed, wanted.store)
        table, scope = moving.run.timetable, Scope(moving.problem, moving.given_up)
        problem = replace(moving.problem, goal=problem.goal, chains=problem.chains)
        if table is None:
            return moving.run.outcome
    with Channel(wanted.run, wanted.store) as channel:
        watchers = [channel.watch, *([watch] if watch else [])]
        return begin(wanted, problem, channel, watchers, limits, table=table, scope=scope)


def resume(
    run: str, *, store: Name = "", watch: Watch | None = None, expansions: int = 1_000_000, seed: int = 0
) -> Ran:
    """Go on with a run after a stop, a pause or a crash; no command is carried out twice. Raises `InvalidInput`."""
    from cellwright.engine.pipelines import execution
    from cellwright.engine.pipelines.execution.channel import Channel
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.store.own import default_store

    where = fspath(store) or default_store()
    with Channel(run, where) as channel:
        watchers = [channel.watch, *([watch] if watch else [])]
        return Ran(execution.resume(where, run, channel, watchers, Limits(expansions, seed=seed)), where)


def tell(run: str, order: OrderName, text: str = "", *, store: Name = "") -> Mapping[str, Any]:
    """Give an order to a run that goes on in another process or thread; returns how it stands.

    `text` is the step of skip and back, the facts of correct, the answer of answer and the command of add. Raises
    `InvalidInput` if nobody carries the run out, or if it refuses the order.
    """
    from cellwright.engine.pipelines.execution import channel
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    state = channel.tell(run, order, text, fspath(store))
    if why := state.get("refused"):
        raise InvalidInput([Diagnostic(Source(run), "K421", f"{order} is refused: {why}")])
    return state


def runs(*, store: Name = "") -> "tuple[Begun, ...]":
    """The runs of a store: their names, when they began, and what was asked."""
    from cellwright.engine.pipelines.results import runs_in
    from cellwright.kb.store.own import default_store

    return runs_in(fspath(store) or default_store())


def results(run: str, *, store: Name = "") -> "Told[Measured]":
    """What a run has measured, with verdicts, and the history of each object. Raises `InvalidInput` for an unknown run."""
    from rich.console import Group

    from cellwright.engine.formats.interop.results.notation import entry
    from cellwright.engine.formats.report import results as report
    from cellwright.engine.formats.report import survey
    from cellwright.engine.pipelines.results import survey_of
    from cellwright.kb.store.own import default_store

    def content(told: "Measured") -> Mapping[str, Any]:
        return entry(told.results) | ({} if told.survey is None else {"survey": survey.entry(told.survey)})

    def shown(told: "Measured") -> "RenderableType":
        more = [] if told.survey is None else ["", survey.text(told.survey)]
        return Group(report.text(told.results, told.subjects), *more)

    return Told(survey_of(fspath(store) or default_store(), run), "ok", content, shown)
