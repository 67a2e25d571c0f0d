"""Composes plans of MACROPs: each part of a problem is solved from where the last one ended.

A part is a chain of the workflow, or a goal that does not hold yet. Steps that the whole plan does
not need are dropped (Nakhost & Müller 2010). The orders between steps are computed anew, so that
parts may overlap in time. If parts disturb each other, no plan is composed, and the planner plans
the whole problem.
"""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import (
    operators_by_instance,
    reached_goals,
    replay_instances,
)
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.macros.lookup.macro_instances import check_instance
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery, goal_signature
from cellwright.engine.stages.planning.action_elimination import eliminate_actions
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps, is_internal
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Literal, goal_parts
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import sort_naturally

MIN_ALIKE_PARTS = 3  # so many parts with the same signature make composing worth while
# the number of parts that are looked up at a time; the cheapest of them is taken
LOOKED_UP_PARTS = 4
MAX_MISSES = 3  # the most parts that may need planning; with more, composing is given up


@dataclass(frozen=True, slots=True)
class PlanPart:
    """Steps of a plan that came from one MACROP: its number and name, the purpose of the steps,
    and the steps.
    """

    macrop: int | None
    name: str
    purpose: str
    steps: tuple[StepId, ...]


@dataclass(frozen=True, slots=True)
class Composed:
    """A plan, its parts in the order in which they were made, and the situation `after` the
    plan.
    """

    plan: Plan
    parts: tuple[PlanPart, ...]
    after: Situation


@dataclass(frozen=True, slots=True)
class ServedPart:
    """A plan for one part, the MACROP that gave it if any, the situation after it, and whether
    it had to be planned.
    """

    plan: Plan
    macrop: int | None
    after: Situation
    planned: bool = False
    name: str = ""


# the flag: whether to plan on a miss
Serve = Callable[[Problem, Situation, bool], ServedPart | None]


def split_problem(problem: Problem, asked: MacroQuery) -> list[Problem]:
    """The parts of a problem: one problem for each chain of the workflow and for each goal that
    does not hold yet.
    """
    chains = [
        dataclasses.replace(problem, goal=ALWAYS_TRUE, chains=(chain,)) for chain in problem.chains
    ]
    goals = [dataclasses.replace(problem, goal=And((goal,)), chains=()) for goal in asked.goals]
    return [*chains, *goals]


def signature_counts(asked: MacroQuery) -> Counter[str]:
    """The signatures of a query's parts, and how often each occurs."""
    kinds = [goal_signature((), [chain.stages]) for chain in asked.chains]
    return Counter([*kinds, *(goal_signature([goal], ()) for goal in asked.goals)])


def worth_composing(asked: MacroQuery) -> bool:
    """Whether enough parts are alike, so that a MACROP learned from one serves the others."""
    return max(signature_counts(asked).values(), default=0) >= MIN_ALIKE_PARTS


def compose_plan(problem: Problem, asked: MacroQuery, serve: Serve) -> Composed | None:
    """A checked plan of parts, each solved by `serve`; None if a part cannot be solved or disturbs
    another one.

    The next part is the cheapest of the first few. A part that costs no more than the cheapest one
    of its kind so far is taken at once.
    """
    line = _PartQueue(split_problem(problem, asked), asked.situation, serve)
    while line.waiting:
        if not line.advance():
            return None
    sequence = _plan_of_sequences(served.plan.steps for _, served in line.made)
    if not isinstance(check_instance(sequence, asked), Situation):
        return None
    return _without_needless_steps(problem, asked, line.made)


@dataclass
class _PartQueue:
    """The parts that are still to be solved, and those that are solved."""

    waiting: list[Problem]
    here: Situation
    serve: Serve
    made: list[tuple[Problem, ServedPart]] = field(default_factory=list)
    misses: int = 0

    def __post_init__(self) -> None:
        self._cheapest: dict[str, int] = {}

    def advance(self) -> bool:
        """Solve one more part. False if that was not possible, or if too many parts had to be
        planned.
        """
        part_served = self._next()
        if part_served is None:
            return False
        part, served = part_served
        kind = _part_kind(part)
        self._cheapest[kind] = min(served.plan.cost, self._cheapest.get(kind, served.plan.cost))
        self.misses += served.planned
        self.made.append(part_served)
        self.waiting.remove(part)
        self.here = served.after
        return self.misses <= MAX_MISSES

    def _next(self) -> tuple[Problem, ServedPart] | None:
        best: tuple[Problem, ServedPart] | None = None
        ready = self._ready()
        for part in ready:
            served = self.serve(part, self.here, False)
            if served is not None and (best is None or served.plan.cost < best[1].plan.cost):
                best = part, served
                if served.plan.cost <= self._cheapest.get(_part_kind(part), -1):
                    break
        if best is None and ready:
            served = self.serve(ready[0], self.here, True)
            best = (ready[0], served) if served is not None else None
        return best

    def _ready(self) -> list[Problem]:
        open_ = {chain.name for part in self.waiting for chain in part.chains}
        return [
            part for part in self.waiting if not any(open_ & set(c.after) for c in part.chains)
        ][:LOOKED_UP_PARTS]


def _part_kind(part: Problem) -> str:
    goals = [conjunct for conjunct in goal_parts(part.goal) if isinstance(conjunct, Literal)]
    return goal_signature(goals, [chain.stages for chain in part.chains])


def _plan_of_sequences(plans: Iterable[Sequence[Step]]) -> Plan:
    steps: list[Step] = []
    for single_step in (step for plan in plans for step in plan):
        number = len(steps) + 1
        after = (StepId(number - 1),) if steps else ()
        steps.append(dataclasses.replace(single_step, id=StepId(number), after=after))
    return Plan(tuple(steps))


def _without_needless_steps(
    problem: Problem, asked: MacroQuery, served_parts: Sequence[tuple[Problem, ServedPart]]
) -> Composed | None:
    """The plan of all parts without needless steps, with its partial order computed anew; None
    if it fails a check.
    """
    task = ground(problem.replace(sort_naturally(asked.facts)))
    origin = [number for number, (_, served) in enumerate(served_parts) for _ in served.plan.steps]
    steps = [step.operator for _, served in served_parts for step in served.plan.steps]
    operators = replay_instances(task, operators_by_instance(task), task.initial, steps)
    if operators is None:
        return None
    plan_and_kept = _ordered_anew(task, operators)
    if plan_and_kept is None:
        return None
    plan, kept_operators = plan_and_kept
    after = check_instance(plan, asked)
    if not isinstance(after, Situation):
        return None
    owners = [origin[position] for position in kept_operators]
    parts = tuple(
        PlanPart(
            served.macrop,
            served.name,
            _part_purpose(part),
            tuple(s.id for s, o in zip(plan.steps, owners, strict=True) if o == number),
        )
        for number, (part, served) in enumerate(served_parts)
    )
    return Composed(plan, parts, after)


def _ordered_anew(
    task: GroundTask, operators: Sequence[GroundOperator]
) -> tuple[Plan, list[int]] | None:
    """The plan of the steps that are needed, and their positions in `operators`; None if there
    is no such plan.
    """
    state = task.initial
    for operator in operators:
        state = task.after(state, operator)
    goals = reached_goals(task, state)
    if (
        goals is None
        or task.axioms is not None
        or any(operator.conditional for operator in operators)
    ):
        return None
    needed_operators = eliminate_actions(task.initial, operators, goals)
    own = [operator for operator in operators if not is_internal(operator.instance)]
    positions, place = [], 0
    for operator in (
        operator_kept
        for operator_kept in needed_operators
        if not is_internal(operator_kept.instance)
    ):
        while own[place] is not operator:
            place += 1
        positions.append(place)
        place += 1
    return deorder_steps(task, needed_operators, goals), positions


def _part_purpose(part: Problem) -> str:
    if part.chains:
        return ", ".join(map(str, part.chains[0].stages))
    return (
        ", ".join(str(conjunct) for conjunct in part.goal.parts)
        if isinstance(part.goal, And)
        else str(part.goal)
    )
