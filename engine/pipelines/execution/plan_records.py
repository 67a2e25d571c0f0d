"""Plans as journal records: enough to execute them again without planning, and to show them."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Generic, TypeVar

from cellwright.engine.model.run_protocol import Finish
from cellwright.engine.model.start_rules import StartRule
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.compiled_program import CompiledProgram
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan
from cellwright.engine.pipelines.execution.run_goals import RunScope, wished_times
from cellwright.engine.pipelines.planning.goal_selection import RelinquishedGoal
from cellwright.engine.stages.execution import Activity, ActivityProgram, Dwell, ExecutiveState
from cellwright.engine.stages.execution.start_forecast import Accuracy, forecast_starts
from cellwright.engine.stages.lifted.cell_domain import StepChange
from cellwright.kb.asp import ground_term
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.store.term_notation import read_stored_atom as read_pattern
from cellwright.kb.store.term_notation import read_term
from cellwright.kb.terms import Function

NONE_ENDED: Mapping[int, int] = {}
Each = TypeVar("Each")


def plan_content(ready: ReadyPlan, why: str, scope: RunScope) -> dict[str, Any]:
    """A plan as a record has it."""
    program = ready.compiled.program
    return {
        "why": why,
        **steps_entry(ready.compiled),
        "timed": program.timed,
        "hands": sorted(program.hands),
        "forecast_ms": program.forecast_ms,
        "goals": list(map(str, goal_parts(scope.problem.goal))),
        "given_up": [[goal.goal, goal.why] for goal in scope.given_up],
        "chains": {c.name: len(c.stages) for c in scope.problem.chains},
        "lost": list(scope.lost),
        "blocked": list(map(str, scope.blocked)),
        **({"wishes": wishes} if (wishes := wished_times(scope.problem)) else {}),
    }


def standing_entry(
    program: ActivityProgram, standing: ExecutiveState, accuracy: Accuracy
) -> dict[str, Any]:
    """How a plan stands when it is noted: the hands that are full, and within which times its
    next steps will begin.
    """
    windows = forecast_starts(program, standing, accuracy).items()
    ahead = [[number, w.start_ms, w.low_ms, w.high_ms] for number, w in windows if w is not None]
    return {"full": sorted(standing.unrested), "ahead": ahead}


def steps_entry(
    compiled: CompiledProgram, without: Collection[int] = (), ended: Mapping[int, int] = NONE_ENDED
) -> dict[str, Any]:
    """The steps of a plan as a record has them, `without` those that are done, of which some have
    `ended` just so.

    What one of these has brought about waits since then.
    """
    return {"steps": list(step_entries(compiled, without)), **order_entry(compiled, without, ended)}


def step_entries(
    compiled: CompiledProgram, without: Collection[int] = ()
) -> Iterator[dict[str, Any]]:
    """Each step of a plan as a record has it, but for those `without`."""
    plan = {int(s.id): s for s in compiled.plan.steps}
    rest_activities = (
        activity for activity in compiled.program.activities.values() if activity.id not in without
    )
    return (
        _step_entry(activity, plan[activity.id], compiled, without) for activity in rest_activities
    )


def order_entry(
    compiled: CompiledProgram, without: Collection[int], ended: Mapping[int, int]
) -> dict[str, Any]:
    """What a record of a plan says of the order of its steps, and of what waits for them."""
    return {
        "order": [int(step.id) for step in compiled.plan.steps if int(step.id) not in without],
        "dwells": [
            _dwell_entry(dwell, ended)
            for dwell in compiled.program.dwells
            if dwell.target not in without
            and (dwell.source not in without or dwell.source in ended)
        ],
    }


def _dwell_entry(dwell: Dwell, ended: Mapping[int, int]) -> list[int | str | None]:
    source, since = dwell.source, dwell.since_ms
    if source in ended:
        source, since = 0, ended[source]
    entry: list[int | str | None] = [source, dwell.target, dwell.most_ms]
    if dwell.thing:
        return [*entry, since, dwell.thing, dwell.place]
    return [*entry, *([] if since is None else [since])]


def end_entry(ending: Finish) -> dict[str, Any]:
    """The end of a run as a record has it."""
    return {
        "outcome": ending.outcome,
        "why": ending.why,
        "goals": list(ending.goals),
        "open_goals": list(ending.open_goals),
        "given_up": [list(goal) for goal in ending.given_up],
        "makespan_ms": ending.makespan_ms,
    }


def _step_entry(
    a: Activity, step: Step, compiled: CompiledProgram, without: Collection[int]
) -> dict[str, Any]:
    change = compiled.changes[a.id]
    result = compiled.results.get(a.id)
    entry = {
        "id": a.id,
        "step": a.action,
        "stream": a.stream,
        "says": a.says,
        "after": [number for number in a.after if number not in without],
        "resources": list(a.resources),
        "start_ms": a.start_ms,
        "lasts_ms": a.lasts_ms,
        "timeout_ms": a.timeout_ms,
        "expects": a.expects,
        "result": None if result is None else str(result),
        "asks": a.asks or None,
        "rests": None if a.rests else False,
        "process": a.process or None,
        "looks": list(a.looks),
        "watches": list(a.watches),
        "rule": None if a.rule is None else _rule_entry(a.rule, without),
        "longest_ms": a.longest_ms,
        "duration": step.duration,
        "cost": step.cost,
        "adds": list(map(str, change.adds)),
        "ends": list(map(str, change.ends)),
        "events": list(map(str, change.events)),
    }
    return {key: value for key, value in entry.items() if value not in (None, "", [])}


@lru_cache(1 << 14)
def read_ground_atom(text: str) -> Function:
    """The ground atom in a text of the journal."""
    atom = ground_term(text)
    assert isinstance(atom, Function)
    return atom


_pattern = lru_cache(1 << 10)(read_term)
_ground = lru_cache(1 << 10)(ground_term)


def compiled_of(entry: Mapping[str, Any]) -> CompiledProgram:
    """The program of a plan that a record has."""
    steps = {step["id"]: step for step in entry["steps"]}
    activities = {number: activity_of(step) for number, step in steps.items()}
    dwells, hands = (
        tuple(Dwell(*dwell) for dwell in entry["dwells"]),
        frozenset(entry.get("hands", ())),
    )
    program = ActivityProgram(activities, dwells, entry["timed"], hands=hands)
    return CompiledProgram(
        program,
        lambda: Plan(tuple(_read_step(steps[number]) for number in entry["order"])),
        ReadOnDemand(steps, _read_change),
        ReadOnDemand(steps, lambda step: _pattern(step["expects"])),
        ReadOnDemand(
            {n: step for n, step in steps.items() if "result" in step},
            lambda step: _pattern(step["result"]),
        ),
    )


@dataclass(frozen=True, slots=True)
class ReadOnDemand(Mapping[int, Each], Generic[Each]):
    """What the steps of a record say, each read when it is asked for: of a long plan a run that
    goes on needs little at once.
    """

    steps: Mapping[int, Mapping[str, Any]]
    read: Callable[[Mapping[str, Any]], Each]

    def __getitem__(self, number: int) -> Each:
        return self.read(self.steps[number])

    def __iter__(self) -> Iterator[int]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)


def scope_of(scope: RunScope, entry: Mapping[str, Any]) -> RunScope:
    """The scope that a plan had, from the one before it."""
    blocked = tuple(read_pattern(pattern) for pattern in entry["blocked"])
    new_scope = scope.changed(
        Revision(lost=tuple(entry["lost"]), blocked=tuple((pattern, "") for pattern in blocked))
    )
    given_up = tuple(RelinquishedGoal(goal, why) for goal, why in entry["given_up"])
    return replace(new_scope.cut(entry["chains"], entry["goals"]), given_up=given_up)


def activity_of(step: Mapping[str, Any]) -> Activity:
    """A step in the record of a plan as the executive sees it."""
    return Activity(
        step["id"],
        step["step"],
        step["stream"],
        step.get("lasts_ms", 0),
        tuple(step.get("after", ())),
        tuple(step.get("resources", ())),
        step.get("start_ms", 0),
        step.get("timeout_ms"),
        step.get("says", ""),
        step.get("expects", ""),
        step.get("asks", False),
        step.get("rests", True),
        step.get("process", False),
        tuple(step.get("looks", ())),
        tuple(step.get("watches", ())),
        _read_rule(step["rule"]) if "rule" in step else None,
        step.get("longest_ms"),
    )


def _rule_entry(rule: StartRule, without: Collection[int]) -> list[Any]:
    """A start rule: its floor, and the times after starts, after ends, and of waits."""
    lags = (rule.starts, rule.ends, rule.waits)
    return [rule.floor, *([[n, t] for n, t in times.items() if n not in without] for times in lags)]


def _read_rule(entry: Sequence[Any]) -> StartRule:
    floor, *lags = entry
    starts, ends, waits = (dict(map(tuple, times)) for times in lags)
    return StartRule(floor, starts, ends, waits)


def _read_step(step: Mapping[str, Any]) -> Step:
    return Step(
        StepId(step["id"]),
        read_ground_atom(step["step"]),
        tuple(map(StepId, step.get("after", ()))),
        tuple(map(_ground, step.get("resources", ()))),
        step.get("duration", 0),
        step.get("cost", 1),
    )


def _read_change(step: Mapping[str, Any]) -> StepChange:
    def atoms(key: str) -> Sequence[Function]:
        return tuple(map(read_ground_atom, step.get(key, ())))

    return StepChange(tuple(atoms("adds")), tuple(atoms("ends")), tuple(atoms("events")))
