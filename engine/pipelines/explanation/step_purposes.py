"""Explains why a step is in a plan, why it is ordered as it is, and which step needs its
effects.
"""

from collections.abc import Iterator, Mapping, Sequence

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.plan_explanation import OrderReason, Purpose, StepReason
from cellwright.engine.model.workflow_replay import said_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.plan_model import GOAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Atom, Function


def explain_step(task: GroundTask, plan: Plan, number: int, name: str = "plan") -> StepReason:
    """The purposes of a step, each traced to a goal, and the reason for each of its orders.

    Raises `InvalidInput`.
    """
    step = next((step for step in plan.steps if step.id == number), None)
    if step is None:
        hint = f"steps are numbered from 1 to {len(plan.steps)}"
        raise InvalidInput(
            [Diagnostic(Source(name), "K410", f"the plan has no step {number}", hint)]
        )
    reasons = _StepReasons(task, plan)
    return StepReason(step, tuple(reasons.purposes(step.id)), tuple(reasons.orders(step)))


class _StepReasons:
    def __init__(self, task: GroundTask, plan: Plan) -> None:
        self.plan = plan
        self.steps = {step.id: step for step in plan.steps}
        self.changes: dict[Function, tuple[set[Atom], set[Atom]]] = {}
        operators_used = {step.operator for step in plan.steps}
        for operator in task.operators:
            if operator.instance in operators_used:
                adds, deletes = self.changes.setdefault(operator.instance, (set(), set()))
                adds.update(task.atoms[index] for index in indices(operator.adds))
                deletes.update(
                    task.atoms[index] for index in indices(operator.deletes & ~operator.adds)
                )

    def purposes(self, number: StepId) -> Iterator[Purpose]:
        """What the step provides, to which step or goal, and the shortest path of causal links
        from there to a goal.
        """
        for link in self.plan.links:
            if link.producer == number:
                yield Purpose(link.condition, self._consumer(link), tuple(self._to_goal(link)))

    def _consumer(self, link: CausalLink) -> Step | None:
        return None if link.consumer == GOAL_STEP else self.steps[link.consumer]

    def _to_goal(self, link: CausalLink) -> Sequence[CausalLink]:
        """The shortest path of causal links from the consumer of `link` to the goal."""
        paths: list[list[CausalLink]] = [[link]]
        seen = {link.consumer}
        for path in paths:
            if path[-1].consumer == GOAL_STEP:
                return path[1:]
            for following in self.plan.links:
                if following.producer == path[-1].consumer and following.consumer not in seen:
                    seen.add(following.consumer)
                    paths.append([*path, following])
        return ()

    def orders(self, step: Step) -> Iterator[OrderReason]:
        """Why the step comes after each of its direct predecessors, and before each of its
        direct successors.
        """
        for earlier_step in step.after:
            yield OrderReason(
                self.steps[earlier_step], step, self._reason(self.steps[earlier_step], step)
            )
        for later in self.plan.steps:
            if step.id in later.after:
                yield OrderReason(step, later, self._reason(step, later))

    def _reason(self, earlier: Step, later: Step) -> str:
        provided = [
            k.condition
            for k in self.plan.links
            if k.producer == earlier.id and k.consumer == later.id
        ]
        if provided:
            return f"it provides {', '.join(map(said_of, dict.fromkeys(provided)))}"
        for link in self.plan.links:
            ends = link.condition in self._deletes(later) or _is_denied(
                link.condition, self._adds(later)
            )
            if link.consumer == earlier.id and ends:
                return f"it needs {said_of(link.condition)}, which the later step ends"
        for link in self.plan.links:
            ends = link.condition in self._deletes(earlier) or _is_denied(
                link.condition, self._adds(earlier)
            )
            if link.producer == later.id and ends:
                return f"it ends {said_of(link.condition)}, which the later step provides"
        shared = sorted(map(str, set(earlier.resources) & set(later.resources)))
        if shared:
            return f"both hold {', '.join(shared)}"
        return "they must not overlap: one changes what the other needs or changes"

    def _adds(self, step: Step) -> set[Atom]:
        return self.changes.get(step.operator, (set(), set()))[0]

    def _deletes(self, step: Step) -> set[Atom]:
        return self.changes.get(step.operator, (set(), set()))[1]


def _is_denied(condition: Atom, adds: set[Atom]) -> bool:
    """Whether `condition` is negative and ends because its atom is added."""
    return (
        condition.name == "not" and len(condition.arguments) == 1 and condition.arguments[0] in adds
    )


def later_uses(
    task: GroundTask, sequence: Sequence[Function], adds: Sequence[Sequence[Atom]], number: int
) -> list[tuple[Atom, Function | None]]:
    """What step `number` (from 0) of a sequence brings, each with the next step that needs it; None
    for what no later step needs.

    `adds` has what each step brings. A fact that another step brings again counts for that one.
    """
    needed = step_needs(task, sequence)
    uses_found: list[tuple[Atom, Function | None]] = []
    for fact in adds[number]:
        consumer: Function | None = None
        for later in range(number + 1, len(sequence)):
            if fact in needed.get(sequence[later], frozenset()):
                consumer = sequence[later]
                break
            if fact in adds[later]:
                break
        uses_found.append((fact, consumer))
    return uses_found


def step_needs(
    task: GroundTask, sequence: Sequence[Function]
) -> Mapping[Function, frozenset[Atom]]:
    """The facts that each step needs."""
    needed_steps, needs_found = set(sequence), dict[Function, set[Atom]]()
    for operator in task.operators:
        if operator.instance in needed_steps:
            own = {task.atoms[index] for index in indices(operator.preconditions)}
            needs_found.setdefault(operator.instance, set()).update(own)
    return {step: frozenset(facts) for step, facts in needs_found.items()}
