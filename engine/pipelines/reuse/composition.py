"""Plans composed of MACROPs: a problem with many similar parts is solved part by part, each from where the last one ended.

A part is a chain of the workflow, or a goal that does not hold yet. Steps that the whole plan does not need are dropped
(Nakhost & Müller 2010). The orders between steps are computed anew, so that parts may overlap in time. If parts disturb
each other, no plan is composed, and the planner plans the whole problem.
"""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.replay import instances, reached_goals, replayed
from cellwright.engine.model.task import GroundOperator, Task
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lookup.checking import check
from cellwright.engine.stages.macros.lookup.query import Query, signature
from cellwright.engine.stages.planning.elimination import eliminate
from cellwright.engine.stages.planning.improvement.deorder import deorder, is_internal
from cellwright.kb.model.conditions import TRUE, And, Literal, goal_parts
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ordered

ALIKE = 3  # so many parts with the same signature make composing worth while
LOOK = 4  # the number of parts that are looked up at a time; the cheapest of them is taken
MISSES = 3  # the most parts that may need planning; with more, composing is given up


@dataclass(frozen=True, slots=True)
class PlanPart:
    """Steps of a plan that came from one MACROP: its number and name, the purpose of the steps, and the steps."""

    macrop: int | None
    name: str
    purpose: str
    steps: tuple[StepId, ...]


@dataclass(frozen=True, slots=True)
class Composed:
    """A plan, its parts in the order in which they were made, and the situation `after` the plan."""

    plan: Plan
    parts: tuple[PlanPart, ...]
    after: Situation


@dataclass(frozen=True, slots=True)
class Served:
    """A plan for one part, the MACROP that gave it if any, the situation after it, and whether it had to be planned."""

    plan: Plan
    macrop: int | None
    after: Situation
    planned: bool = False
    name: str = ""


Serve = Callable[[Problem, Situation, bool], Served | None]  # the flag: whether to plan on a miss


def parts_of(problem: Problem, asked: Query) -> list[Problem]:
    """The parts of a problem: one problem for each chain of the workflow and for each goal that does not hold yet."""
    chains = [dataclasses.replace(problem, goal=TRUE, chains=(each,)) for each in problem.chains]
    goals = [dataclasses.replace(problem, goal=And((each,)), chains=()) for each in asked.goals]
    return [*chains, *goals]


def kinds_of(asked: Query) -> Counter[str]:
    """The signatures of a query's parts, and how often each occurs."""
    kinds = [signature((), [chain.stages]) for chain in asked.chains]
    return Counter([*kinds, *(signature([goal], ()) for goal in asked.goals)])


def worth_composing(asked: Query) -> bool:
    """Whether enough parts are alike, so that a MACROP learned from one serves the others."""
    return max(kinds_of(asked).values(), default=0) >= ALIKE


def compose(problem: Problem, asked: Query, serve: Serve) -> Composed | None:
    """A checked plan of parts, each solved by `serve`; None if a part cannot be solved or disturbs another one.

    The next part is the cheapest of the first few. A part that costs no more than the cheapest one of its kind so far is
    taken at once.
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
    """The parts that are still to be solved, and those that are solved."""

    waiting: list[Problem]
    here: Situation
    serve: Serve
    made: list[tuple[Problem, Served]] = field(default_factory=list)
    misses: int = 0

    def __post_init__(self) -> None:
        self._cheapest: dict[str, int] = {}

    def advance(self) -> bool:
        """Solve one more part. False if that was not possible, or if too many parts had to be planned."""
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
    """The plan of all parts without needless steps, with its partial order computed anew; None if it fails a check."""
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
        PlanPart(
            served.macrop,
            served.name,
            _purpose(part),
            tuple(s.id for s, o in zip(plan.steps, owners, strict=True) if o == number),
        )
        for number, (part, served) in enumerate(made)
    )
    return Composed(plan, parts, after)


def _ordered_anew(task: Task, operators: Sequence[GroundOperator]) -> tuple[Plan, list[int]] | None:
    """The plan of the steps that are needed, and their positions in `operators`; None if there is no such plan."""
    state = task.initial
    for operator in operators:
        state = task.after(state, operator)
    goals = reached_goals(task, state)
    if goals is None or task.axioms is not None or any(operator.conditional for operator in operators):
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
