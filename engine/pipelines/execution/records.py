"""Plans in the journal: enough to execute them again without planning, and to show them."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Generic, TypeVar

from cellwright.engine.model.cases import Revision
from cellwright.engine.model.execution import Finish
from cellwright.engine.pipelines.attainment import GivenUp
from cellwright.engine.pipelines.execution.adding import wished
from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.planned import Ready
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.stages.execution import Activity, Dwell, Program, Standing
from cellwright.engine.stages.execution.outlook import Accuracy, outlook
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.kb.asp import ground_term
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.store.notation import read_atom as read_pattern
from cellwright.kb.store.notation import read_term
from cellwright.kb.terms import Function

NOTHING: Mapping[int, int] = {}
Each = TypeVar("Each")


def plan_entry(ready: Ready, why: str, scope: Scope) -> dict[str, Any]:
    """A plan as a record has it."""
    program = ready.compiled.program
    return {
        "why": why,
        **steps_entry(ready.compiled),
        "timed": program.timed,
        "hands": sorted(program.hands),
        "forecast_ms": program.forecast_ms,
        "goals": list(map(str, goal_parts(scope.problem.goal))),
        "given_up": [[each.goal, each.why] for each in scope.given_up],
        "chains": {c.name: len(c.stages) for c in scope.problem.chains},
        "lost": list(scope.lost),
        "blocked": list(map(str, scope.blocked)),
        **({"wishes": wishes} if (wishes := wished(scope.problem)) else {}),
    }


def standing_entry(program: Program, standing: Standing, accuracy: Accuracy) -> dict[str, Any]:
    """How a plan stands when it is noted: the hands that are full, and within which times its next steps will begin."""
    windows = outlook(program, standing, accuracy).items()
    ahead = [[each, w.start_ms, w.low_ms, w.high_ms] for each, w in windows if w is not None]
    return {"full": sorted(standing.unrested), "ahead": ahead}


def steps_entry(
    compiled: Compiled, without: Collection[int] = (), ended: Mapping[int, int] = NOTHING
) -> dict[str, Any]:
    """The steps of a plan as a record has them, `without` those that are done, of which some have `ended` just so.

    What one of these has brought about waits since then.
    """
    return {"steps": list(step_entries(compiled, without)), **order_entry(compiled, without, ended)}


def step_entries(compiled: Compiled, without: Collection[int] = ()) -> Iterator[dict[str, Any]]:
    """Each step of a plan as a record has it, but for those `without`."""
    plan = {int(s.id): s for s in compiled.plan.steps}
    left = (each for each in compiled.program.activities.values() if each.id not in without)
    return (_step_entry(each, plan[each.id], compiled, without) for each in left)


def order_entry(compiled: Compiled, without: Collection[int], ended: Mapping[int, int]) -> dict[str, Any]:
    """What a record of a plan says of the order of its steps, and of what waits for them."""
    return {
        "order": [int(step.id) for step in compiled.plan.steps if int(step.id) not in without],
        "dwells": [
            _dwell_entry(each, ended)
            for each in compiled.program.dwells
            if each.target not in without and (each.source not in without or each.source in ended)
        ],
    }


def _dwell_entry(dwell: Dwell, ended: Mapping[int, int]) -> list[int]:
    source, since = dwell.source, dwell.since_ms
    if source in ended:
        source, since = 0, ended[source]
    return [source, dwell.target, dwell.most_ms, *([] if since is None else [since])]


def end_entry(ending: Finish) -> dict[str, Any]:
    """The end of a run as a record has it."""
    return {
        "outcome": ending.outcome,
        "why": ending.why,
        "goals": list(ending.goals),
        "open_goals": list(ending.open_goals),
        "given_up": [list(each) for each in ending.given_up],
        "makespan_ms": ending.makespan_ms,
    }


def _step_entry(a: Activity, step: Step, compiled: Compiled, without: Collection[int]) -> dict[str, Any]:
    change = compiled.changes[a.id]
    result = compiled.results.get(a.id)
    found = {
        "id": a.id,
        "step": a.action,
        "stream": a.stream,
        "says": a.says,
        "after": [each for each in a.after if each not in without],
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
        "duration": step.duration,
        "cost": step.cost,
        "adds": list(map(str, change.adds)),
        "ends": list(map(str, change.ends)),
        "events": list(map(str, change.events)),
    }
    return {key: value for key, value in found.items() if value not in (None, "", [])}


@lru_cache(1 << 14)
def read_atom(text: str) -> Function:
    """The ground atom in a text of the journal."""
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


_pattern = lru_cache(1 << 10)(read_term)
_ground = lru_cache(1 << 10)(ground_term)


def compiled_of(entry: Mapping[str, Any]) -> Compiled:
    """The program of a plan that a record has."""
    steps = {each["id"]: each for each in entry["steps"]}
    activities = {number: activity_of(each) for number, each in steps.items()}
    dwells, hands = tuple(Dwell(*each) for each in entry["dwells"]), frozenset(entry.get("hands", ()))
    program = Program(activities, dwells, entry["timed"], hands=hands)
    return Compiled(
        program,
        lambda: Plan(tuple(_step(steps[number]) for number in entry["order"])),
        Read(steps, _change),
        Read(steps, lambda each: _pattern(each["expects"])),
        Read(
            {n: each for n, each in steps.items() if "result" in each}, lambda each: _pattern(each["result"])
        ),
    )


@dataclass(frozen=True, slots=True)
class Read(Mapping[int, Each], Generic[Each]):
    """What the steps of a record say, each read when it is asked for: of a long plan a run that goes on needs little at once."""

    steps: Mapping[int, Mapping[str, Any]]
    read: Callable[[Mapping[str, Any]], Each]

    def __getitem__(self, number: int) -> Each:
        return self.read(self.steps[number])

    def __iter__(self) -> Iterator[int]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)


def scope_of(scope: Scope, entry: Mapping[str, Any]) -> Scope:
    """The scope that a plan had, from the one before it."""
    blocked = tuple(read_pattern(each) for each in entry["blocked"])
    found = scope.changed(Revision(lost=tuple(entry["lost"]), blocked=tuple((each, "") for each in blocked)))
    given_up = tuple(GivenUp(goal, why) for goal, why in entry["given_up"])
    return replace(found.cut(entry["chains"], entry["goals"]), given_up=given_up)


def activity_of(each: Mapping[str, Any]) -> Activity:
    """A step in the record of a plan as the executive sees it."""
    return Activity(
        each["id"],
        each["step"],
        each["stream"],
        each.get("lasts_ms", 0),
        tuple(each.get("after", ())),
        tuple(each.get("resources", ())),
        each.get("start_ms", 0),
        each.get("timeout_ms"),
        each.get("says", ""),
        each.get("expects", ""),
        each.get("asks", False),
        each.get("rests", True),
        each.get("process", False),
        tuple(each.get("looks", ())),
        tuple(each.get("watches", ())),
    )


def _step(each: Mapping[str, Any]) -> Step:
    return Step(
        StepId(each["id"]),
        read_atom(each["step"]),
        tuple(map(StepId, each.get("after", ()))),
        tuple(map(_ground, each.get("resources", ()))),
        each.get("duration", 0),
        each.get("cost", 1),
    )


def _change(each: Mapping[str, Any]) -> StepChange:
    def atoms(key: str) -> Sequence[Function]:
        return tuple(map(read_atom, each.get(key, ())))

    return StepChange(tuple(atoms("adds")), tuple(atoms("ends")), tuple(atoms("events")))
