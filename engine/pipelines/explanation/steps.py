"""Why a step is in a plan, and why it comes before and after other steps."""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.explanation import OrderReason, Purpose, StepReason
from cellwright.engine.model.stages import said_of
from cellwright.engine.model.task import Task, indices
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.plan import GOAL, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Atom, Function


def why(task: Task, plan: Plan, number: int, name: str = "plan") -> StepReason:
    """The purposes of a step, each traced to a goal, and the reason for each of its orders. Raises `InvalidInput`."""
    step = next((each for each in plan.steps if each.id == number), None)
    if step is None:
        hint = f"steps are numbered from 1 to {len(plan.steps)}"
        raise InvalidInput([Diagnostic(Source(name), "K410", f"the plan has no step {number}", hint)])
    reasons = _Reasons(task, plan)
    return StepReason(step, tuple(reasons.purposes(step.id)), tuple(reasons.orders(step)))


class _Reasons:
    def __init__(self, task: Task, plan: Plan) -> None:
        self.plan = plan
        self.steps = {step.id: step for step in plan.steps}
        self.changes: dict[Function, tuple[set[Atom], set[Atom]]] = {}
        wanted = {step.operator for step in plan.steps}
        for operator in task.operators:
            if operator.instance in wanted:
                adds, deletes = self.changes.setdefault(operator.instance, (set(), set()))
                adds.update(task.atoms[index] for index in indices(operator.adds))
                deletes.update(task.atoms[index] for index in indices(operator.deletes & ~operator.adds))

    def purposes(self, number: StepId) -> Iterator[Purpose]:
        """What the step provides, to which step or goal, and the shortest path of causal links from there to a goal."""
        for link in self.plan.links:
            if link.producer == number:
                yield Purpose(link.condition, self._consumer(link), tuple(self._to_goal(link)))

    def _consumer(self, link: CausalLink) -> Step | None:
        return None if link.consumer == GOAL else self.steps[link.consumer]

    def _to_goal(self, link: CausalLink) -> Sequence[CausalLink]:
        """The shortest path of causal links from the consumer of `link` to the goal."""
        paths: list[list[CausalLink]] = [[link]]
        seen = {link.consumer}
        for path in paths:
            if path[-1].consumer == GOAL:
                return path[1:]
            for following in self.plan.links:
                if following.producer == path[-1].consumer and following.consumer not in seen:
                    seen.add(following.consumer)
                    paths.append([*path, following])
        return ()

    def orders(self, step: Step) -> Iterator[OrderReason]:
        """Why the step comes after each of its direct predecessors, and before each of its direct successors."""
        for other in step.after:
            yield OrderReason(self.steps[other], step, self._reason(self.steps[other], step))
        for later in self.plan.steps:
            if step.id in later.after:
                yield OrderReason(step, later, self._reason(step, later))

    def _reason(self, earlier: Step, later: Step) -> str:
        provided = [
            k.condition for k in self.plan.links if k.producer == earlier.id and k.consumer == later.id
        ]
        if provided:
            return f"it provides {', '.join(map(said_of, dict.fromkeys(provided)))}"
        for link in self.plan.links:
            ends = link.condition in self._deletes(later) or _denied(link.condition, self._adds(later))
            if link.consumer == earlier.id and ends:
                return f"it needs {said_of(link.condition)}, which the later step ends"
        for link in self.plan.links:
            ends = link.condition in self._deletes(earlier) or _denied(link.condition, self._adds(earlier))
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


def _denied(condition: Atom, adds: set[Atom]) -> bool:
    """Whether `condition` is negative and ends because its atom is added."""
    return condition.name == "not" and len(condition.arguments) == 1 and condition.arguments[0] in adds
