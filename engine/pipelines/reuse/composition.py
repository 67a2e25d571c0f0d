"""Plans composed of MACROPs: a problem of many like parts is served part by part, each from where the last one ended.

A part is a chain of the workflow, or a goal that does not hold yet. What parts do twice is dropped from the whole (Nakhost &
Müller 2010), and orders are made anew, so that parts overlap where they may. Nothing hangs on it: where parts disturb each
other, the planner plans the whole.
"""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from engine.model.replay import instances, reached_goals, replayed
from engine.model.task import GroundOperator, Task, progress
from engine.stages.grounding import ground
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lookup.checking import check
from engine.stages.macros.lookup.query import Query, signature
from engine.stages.planning.elimination import eliminate
from engine.stages.planning.improvement.deorder import deorder, is_internal
from kb.model.conditions import TRUE, And, Literal, goal_parts
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import ordered

ALIKE = 3  # parts of one signature that make composing worth while
LOOK = 4  # parts that are looked up before the cheapest is taken
MISSES = 3  # parts that may have to be planned before composing is given up


@dataclass(frozen=True, slots=True)
class Part:
    """Steps that came from one MACROP: its number and name, what the instance is for, and the steps."""

    macrop: int | None
    name: str
    purpose: str
    steps: tuple[StepId, ...]


@dataclass(frozen=True, slots=True)
class Composed:
    """A plan and its parts in the order in which they were made."""

    plan: Plan
    parts: tuple[Part, ...]
    after: Situation


@dataclass(frozen=True, slots=True)
class Served:
    """What serving one part gave."""

    plan: Plan
    macrop: int | None
    after: Situation
    planned: bool = False
    name: str = ""


Serve = Callable[[Problem, Situation, bool], Served | None]  # the last one: whether to plan on a miss


def parts_of(problem: Problem, asked: Query) -> list[Problem]:
    """The parts of a problem: a problem for each chain of the workflow and for each open goal."""
    chains = [dataclasses.replace(problem, goal=TRUE, chains=(each,)) for each in problem.chains]
    goals = [dataclasses.replace(problem, goal=And((each,)), chains=()) for each in asked.goals]
    return [*chains, *goals]


def kinds_of(asked: Query) -> Counter[str]:
    """The signatures of a query's parts, counted."""
    kinds = [signature((), [chain.stages]) for chain in asked.chains]
    return Counter([*kinds, *(signature([goal], ()) for goal in asked.goals)])


def worth_composing(asked: Query) -> bool:
    """Whether enough parts are alike, so that what is learned from one serves the others."""
    return max(kinds_of(asked).values(), default=0) >= ALIKE


def compose(problem: Problem, asked: Query, serve: Serve) -> Composed | None:
    """A checked plan of parts, each served by `serve`; None if some part cannot be, or disturbs another.

    The next part is the cheapest of the few that stand first; one that is as cheap as its kind was before is taken at once.
    """
    line = _Line(parts_of(problem, asked), asked.situation, serve)
    while line.waiting:
        if not line.advance():
            return None
    sequence = _sequence(served.plan.steps for _, served in line.made)
    if not isinstance(check(sequence, asked), Situation):
        return None
    return _slim(problem, asked, line.made)


@dataclass
class _Line:
    """Parts that wait to be served, and those that were."""

    waiting: list[Problem]
    here: Situation
    serve: Serve
    made: list[tuple[Problem, Served]] = field(default_factory=list)
    misses: int = 0

    def __post_init__(self) -> None:
        self._cheapest: dict[str, int] = {}

    def advance(self) -> bool:
        """Serve one part more; whether that was possible."""
        found = self._next()
        if found is None:
            return False
        part, served = found
        kind = _kind(part)
        self._cheapest[kind] = min(served.plan.cost, self._cheapest.get(kind, served.plan.cost))
        self.misses += served.planned
        self.made.append(found)
        self.waiting.remove(part)
        self.here = served.after
        return self.misses <= MISSES

    def _next(self) -> tuple[Problem, Served] | None:
        best: tuple[Problem, Served] | None = None
        ready = self._ready()
        for part in ready:
            served = self.serve(part, self.here, False)
            if served is not None and (best is None or served.plan.cost < best[1].plan.cost):
                best = part, served
                if served.plan.cost <= self._cheapest.get(_kind(part), -1):
                    break
        if best is None and ready:
            served = self.serve(ready[0], self.here, True)
            best = (ready[0], served) if served is not None else None
        return best

    def _ready(self) -> list[Problem]:
        open_ = {chain.name for part in self.waiting for chain in part.chains}
        return [part for part in self.waiting if not any(open_ & set(c.after) for c in part.chains)][:LOOK]


def _kind(part: Problem) -> str:
    goals = [each for each in goal_parts(part.goal) if isinstance(each, Literal)]
    return signature(goals, [chain.stages for chain in part.chains])


def _sequence(plans: Iterable[Sequence[Step]]) -> Plan:
    steps: list[Step] = []
    for each in (step for plan in plans for step in plan):
        number = len(steps) + 1
        after = (StepId(number - 1),) if steps else ()
        steps.append(dataclasses.replace(each, id=StepId(number), after=after))
    return Plan(tuple(steps))


def _slim(problem: Problem, asked: Query, made: Sequence[tuple[Problem, Served]]) -> Composed | None:
    """The whole without needless steps, partially ordered anew."""
    task = ground(problem.replace(ordered(asked.facts)))
    origin = [number for number, (_, served) in enumerate(made) for _ in served.plan.steps]
    steps = [step.operator for _, served in made for step in served.plan.steps]
    operators = replayed(task, instances(task), task.initial, steps)
    if operators is None:
        return None
    found = _ordered_anew(task, operators)
    if found is None:
        return None
    plan, kept = found
    after = check(plan, asked)
    if not isinstance(after, Situation):
        return None
    owners = [origin[position] for position in kept]
    parts = tuple(
        Part(
            served.macrop,
            served.name,
            _purpose(part),
            tuple(s.id for s, o in zip(plan.steps, owners, strict=True) if o == number),
        )
        for number, (part, served) in enumerate(made)
    )
    return Composed(plan, parts, after)


def _ordered_anew(task: Task, operators: Sequence[GroundOperator]) -> tuple[Plan, list[int]] | None:
    """The plan of the steps that are needed, and their positions."""
    state = task.initial
    for operator in operators:
        state = progress(state, operator)
    goals = reached_goals(task, state)
    if goals is None or any(operator.conditional for operator in operators):
        return None
    kept = eliminate(task.initial, operators, goals)
    own = [operator for operator in operators if not is_internal(operator.instance)]
    positions, place = [], 0
    for operator in (each for each in kept if not is_internal(each.instance)):
        while own[place] is not operator:
            place += 1
        positions.append(place)
        place += 1
    return deorder(task, kept, goals), positions


def _purpose(part: Problem) -> str:
    if part.chains:
        return ", ".join(map(str, part.chains[0].stages))
    return ", ".join(str(each) for each in part.goal.parts) if isinstance(part.goal, And) else str(part.goal)
