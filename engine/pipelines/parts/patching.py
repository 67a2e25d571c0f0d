"""A plan in the order of a sequence is patched where one of its steps may not be taken any more: everything else stays as it was."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from engine.model.measurements import named
from engine.model.outcome import Found, Infeasible, Outcome
from engine.pipelines.gate import PlanGate
from engine.pipelines.parts.chain import Chain
from engine.pipelines.parts.itinerary import Itinerary, Part
from engine.pipelines.parts.joining import joined
from engine.pipelines.parts.memory import Notebook
from engine.stages.grounding.initial import initial_state
from engine.stages.grounding.program import Vocabulary
from engine.stages.macros.lifted.execution import changes_of
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain, StepChange
from engine.stages.macros.lookup.query import goal_literal
from engine.stages.planning import Limits
from kb.model.conditions import Literal, goal_parts
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Atom

State = frozenset[Atom]


@dataclass(frozen=True)
class _Old:
    """The plan as it was: its steps, the state before each and after the last, and after which step each measurement is made."""

    steps: Sequence[Step]
    states: Sequence[State]
    ends: Mapping[str, int]


def patched(
    problem: Problem, plan: Plan, way: Itinerary, failed: StepId, limits: Limits = Limits()
) -> Outcome | None:
    """The plan with the part of the failed step planned anew, and the parts behind it until all is as it was.

    `problem` is that of the plan, with fewer goals or stricter operators. The answer is infeasible if the part has no plan of its
    own; None if another plan must be found.
    """
    steps, known = plan.steps, {operator.name for operator in problem.domain.operators}
    if any(step.operator.name not in known for step in steps):
        return None
    state, contradicted = initial_state(problem, Vocabulary(problem.domain))
    if contradicted:
        return None
    start = Situation.of(CellDomain(problem), state)
    old = _replayed(problem, start, steps, way)
    at = next(n for n, step in enumerate(steps) if step.id == failed)
    found = _gone_on(problem, way, old, at, start, limits)
    return _made(problem, start, found) if isinstance(found, list) else found


def _replayed(problem: Problem, start: Situation, steps: Sequence[Step], way: Itinerary) -> _Old:
    changes = changes_of(start, steps)
    states, facts = [start.state], set(start.state)
    for change in changes:
        facts = (facts - set(change.ends)) | set(change.adds)
        states.append(frozenset(facts))
    names = {name for name, _ in way.visits}
    return _Old(steps, states, _ends(problem, changes, names))


def _ends(problem: Problem, changes: Sequence[StepChange], names: set[str]) -> dict[str, int]:
    measured, found = problem.domain.conventions.measured, dict[str, int]()
    for n, change in enumerate(changes):
        for atom in change.adds:
            if atom.name == measured:
                for name in named(Literal(atom), names):
                    found.setdefault(name, n)
    return found


def _gone_on(
    problem: Problem, way: Itinerary, old: _Old, at: int, start: Situation, limits: Limits
) -> list[Step] | Infeasible | None:
    """The steps up to the part of the failed one, the parts from there on until the state is the old one, and the rest as it was."""
    begins = max((end + 1 for end in old.ends.values() if end < at), default=0)
    here = Situation.of(start.world, old.states[begins])
    line = Chain(problem, here, Notebook(), limits, list(old.steps[:begins]))
    parts = [part for part in way.parts(problem) if old.ends.get(part.name, len(old.steps)) >= begins]
    lost = {name for name in old.ends if name not in {part.name for part in way.parts(problem)}}
    for part in parts:
        failed = line.run([part])
        if failed is not None:
            return _hopeless(line, part, start)
        end = old.ends.get(part.name)
        if end is not None and end >= at and _alike(line.here.state, old.states[end + 1], lost):
            return [*line.steps, *old.steps[end + 1 :]]
    return line.steps


def _hopeless(line: Chain, part: Part, start: Situation) -> Infeasible | None:
    alone = line.alone(part, start)
    if not isinstance(alone, Infeasible):
        return None
    about = f"{part.name}: " if part.name else ""
    return Infeasible(f"{about}{alone.reason}", alone.statistics)


def _alike(one: State, other: State, lost: set[str]) -> bool:
    """Whether two states differ in nothing but what is about lost measurements."""
    return all(named(Literal(atom), lost) for atom in one ^ other)


def _made(problem: Problem, start: Situation, steps: Sequence[Step]) -> Found | None:
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    plan = joined(start, steps, [goal for goal in goals if goal is not None])
    plan, wrong = PlanGate().settled(problem, plan)
    return None if wrong else Found(plan)
