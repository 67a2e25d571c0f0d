"""A plan in the order of a sequence is patched where one of its steps may not be taken any more: everything else stays as it was."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.measurements import named
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.parts.chain import Chain, Part
from cellwright.engine.pipelines.parts.itinerary import Itinerary
from cellwright.engine.pipelines.parts.joining import joined, of_arms
from cellwright.engine.pipelines.parts.memory import Notebook
from cellwright.engine.stages.grounding.initial import initial_state
from cellwright.engine.stages.grounding.program import Vocabulary
from cellwright.engine.stages.macros.lifted.execution import changes_of
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain, StepChange
from cellwright.engine.stages.macros.lookup.query import goal_literal
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom


@dataclass(frozen=True)
class _Old:
    """The plan as it was: its steps, what each has changed, and after which step each measurement is made."""

    steps: Sequence[Step]
    changes: Sequence[StepChange]
    ends: Mapping[str, int]

    def went_on(self, state: set[Atom], first: int, last: int) -> None:
        """Change a state as the steps from the first to before the last have done."""
        for change in self.changes[first:last]:
            state.difference_update(change.ends)
            state.update(change.adds)


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
    changes = changes_of(start, steps)
    old = _Old(steps, changes, _ends(problem, changes, {name for name, _ in way.visits}))
    at = next(n for n, step in enumerate(steps) if step.id == failed)
    found = _gone_on(problem, way, old, at, start, limits)
    return _made(problem, start, found, way) if isinstance(found, list) else found


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
    was = set(start.state)
    old.went_on(was, 0, begins)
    line = Chain(problem, Situation.of(start.world, was), Notebook(), limits, list(old.steps[:begins]))
    every = way.parts(problem)
    parts = [part for part in every if old.ends.get(part.name, len(old.steps)) >= begins]
    lost, gone = set(old.ends) - {part.name for part in every}, begins
    for part in parts:
        failed = line.run([part])
        if failed is not None:
            return _hopeless(line, part, start)
        end = old.ends.get(part.name)
        if end is None or end < at:
            continue
        old.went_on(was, gone, end + 1)
        gone = end + 1
        if _alike(line.here.state, was, lost):
            return [*line.steps, *old.steps[gone:]]
    return line.steps


def _hopeless(line: Chain, part: Part, start: Situation) -> Infeasible | None:
    alone = line.alone(part, start)
    if not isinstance(alone, Infeasible):
        return None
    about = f"{part.name}: " if part.name else ""
    return Infeasible(f"{about}{alone.reason}", alone.statistics)


def _alike(one: frozenset[Atom], other: set[Atom], lost: set[str]) -> bool:
    """Whether two states differ in nothing but what is about lost measurements."""
    return all(named(Literal(atom), lost) for atom in one ^ other)


def _made(problem: Problem, start: Situation, steps: Sequence[Step], way: Itinerary) -> Found | None:
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    plan = joined(start, steps, [goal for goal in goals if goal is not None], of_arms(problem, way))
    plan, wrong = PlanGate().settled(problem, plan)
    return None if wrong else Found(plan)
