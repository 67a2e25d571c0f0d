"""The checker: does a partially ordered plan do what it claims, in every order and overlap that it allows?

It executes the steps in one order against the domain itself, verifies every causal link, and shows that
unordered steps cannot disturb each other. So every other order gives the same result. It shares no code with
grounding or search. Both use these parts of `kb`: terms and how they are matched (`kb.terms`), their
arithmetic (`kb.arithmetic`), what clingo derives from the static rules (`kb.asp`), and what a workflow means
(`kb.model.workflow`).
"""

from collections.abc import Iterator
from functools import cached_property

from engine.stages.validation.changes import Change
from engine.stages.validation.datalog import Facts, holds
from engine.stages.validation.interference import Executed, Interference, is_stage, signed
from engine.stages.validation.semantics import Semantics
from engine.stages.validation.workflow import ChainProgress
from kb.diagnostics import Diagnostic, Source
from kb.model.conditions import And, Condition, Literal, literals
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Atom, Substitution, substitute, substitute_atom


def validate(problem: Problem, plan: Plan, name: str = "plan") -> list[Diagnostic]:
    """Everything that is wrong with a plan, in the order of its steps; empty if it is valid."""
    return findings(Semantics(problem), plan, name)


def findings(semantics: Semantics, plan: Plan, name: str = "plan") -> list[Diagnostic]:
    """The same as `validate`, for a semantics whose static facts may have been evaluated already."""
    return _Check(semantics, plan, Source(name)).run()


class _Check:
    def __init__(self, semantics: Semantics, plan: Plan, where: Source) -> None:
        self.problem, self.plan, self.where = semantics.problem, plan, where
        self.semantics = semantics
        self.found: list[Diagnostic] = []
        self.executed: dict[StepId, Executed] = {}
        self.final = Facts()

    def run(self) -> list[Diagnostic]:
        if not self._well_formed():
            return self.found
        self.before = self.plan.predecessors()
        if self._executes():
            self._reaches_goals()
            self._check_links()
            self._check_stages()
            for conflict in self._interference().conflicts():
                self._report("K503", conflict)
        return self.found

    def _report(self, code: str, message: str, hint: str = "") -> None:
        self.found.append(Diagnostic(self.where, code, message, hint))

    def _well_formed(self) -> bool:
        """Whether step numbers are distinct and positive, and every step that is waited for or linked exists."""
        seen: set[StepId] = set()
        for step in self.plan.steps:
            for other in step.after:
                if other not in seen:
                    self._report(
                        "K505", f"step {step.id} waits for {other}, which does not come before it in the list"
                    )
            if step.id in seen or step.id <= 0:
                self._report("K507", f"step number {step.id} is used twice or not positive")
            seen.add(step.id)
        known = seen | {START, GOAL}
        for link in self.plan.links:
            if link.producer not in known or link.consumer not in known:
                self._report(
                    "K504", f"a link names a step that does not exist: {link.producer} to {link.consumer}"
                )
        return not self.found

    def _executes(self) -> bool:
        self.start = self.semantics.initial()
        state = self.semantics.layer(self.start)
        stages = ChainProgress(self.problem.domain, self.problem.chains)
        for step in self.plan.steps:
            change = self._execute(step, state)
            if change is None:
                return False
            unexpected = stages.step(step.id, change.events, change.adds)
            if unexpected is not None:
                self._report(
                    "K506", f"step {step.id} {step.operator}: {unexpected} is not the next stage of any chain"
                )
                return False
            state = state.after(change.ends, change.adds)
        self.final, self.stages = state, stages
        return True

    def _execute(self, step: Step, state: Facts) -> Change | None:
        bound = self.semantics.binding(step.operator)
        if isinstance(bound, str):
            self._report("K501", f"step {step.id} {step.operator}: {bound}")
            return None
        operator, bindings = bound
        expected = tuple(substitute(resource, bindings) for resource in operator.resources)
        if set(expected) - set(step.resources):
            held = ", ".join(map(str, expected))
            self._report("K501", f"step {step.id} {step.operator} must hold {held}")
            return None
        facts = self.semantics.facts(state)
        failed = next(iter(self._failed(operator.precondition, facts, bindings)), None)
        if failed is not None:
            self._report(
                "K501",
                f"step {step.id} {step.operator}: {failed} does not hold when it starts",
                self._why(failed),
            )
            return None
        change = self.semantics.change(operator, bindings, facts, state)
        if change.contradiction is not None:
            self._report(
                "K501", f"step {step.id} {step.operator} both adds and denies {change.contradiction}"
            )
            return None
        self.executed[step.id] = Executed(step, operator, bindings, change)
        return change

    def _failed(self, condition: Condition, facts: Facts, bindings: Substitution) -> Iterator[str]:
        """The conjuncts that do not hold, written with their values."""
        if isinstance(condition, And):
            for part in condition.parts:
                yield from self._failed(part, facts, bindings)
        elif not holds(condition, facts, bindings):
            yield _said(condition, bindings)

    def _why(self, failed: str) -> str:
        for executed in reversed(self.executed.values()):
            if any(str(atom) == failed for atom in executed.change.ends):
                return f"step {executed.step.id} {executed.step.operator} ended it"
        return ""

    def _reaches_goals(self) -> None:
        facts = self.semantics.facts(self.final)
        for failed in self._failed(self.problem.goal, facts, {}):
            self._report("K502", f"the goal {failed} does not hold at the end", self._why(failed))
        for stage in self.stages.missing(self.final):
            self._report("K506", f"the workflow misses {stage}")

    def _check_stages(self) -> None:
        for earlier, later, why in self.stages.orders():
            if earlier != later and earlier not in self.before[later]:
                self._report("K506", f"steps {earlier} and {later} must be ordered: {why}")

    def _check_links(self) -> None:
        for link in self.plan.links:
            if not is_stage(link.condition):
                self._check_link(link)

    def _check_link(self, link: CausalLink) -> None:
        said = f"link {link.producer} to {link.consumer} for {link.condition}"
        atom, positive = signed(link.condition)
        if (
            link.producer != START
            and link.consumer != GOAL
            and link.producer not in self.before[link.consumer]
        ):
            self._report("K504", f"{said}: the producer is not ordered before the consumer")
            return
        if not self._produces(link.producer, atom, positive):
            self._report("K504", f"{said}: the producer does not achieve it")
            return
        for executed in self._touching[atom]:
            other = executed.step.id
            early = link.producer != START and other in self.before[link.producer]
            late = link.consumer != GOAL and link.consumer in self.before[other]
            if early or late or other in (link.producer, link.consumer):
                continue
            if self._destroys(executed, atom, positive):
                self._report(
                    "K504", f"{said}: step {other} {executed.step.operator} can come between and end it"
                )
                return

    @cached_property
    def _touching(self) -> dict[Atom, list[Executed]]:
        """For the condition of each link the steps that may add or deny it, in their order."""
        touching: dict[Atom, list[Executed]] = {signed(link.condition)[0]: [] for link in self.plan.links}
        for executed in self.executed.values():
            atoms = touching if executed.deductions else executed.denied | executed.change.adds
            for atom in atoms:
                if atom in touching:
                    touching[atom].append(executed)
        return touching

    def _produces(self, producer: StepId, atom: Atom, positive: bool) -> bool:
        if producer == START:
            return (atom in self.start) == positive
        change = self.executed[producer].change
        if positive:
            return atom in change.adds
        return atom not in change.adds and any(
            d.matches(atom, self.semantics.statics) for d in change.denials
        )

    def _destroys(self, executed: Executed, atom: Atom, positive: bool) -> bool:
        if not positive:
            return atom in executed.change.adds
        return atom not in executed.change.adds and executed.denies(atom, self.semantics.statics)

    def _interference(self) -> Interference:
        return Interference(self.problem, self.plan, self.semantics, self.executed, self.before, self.start)


def _said(condition: Condition, bindings: Substitution) -> str:
    if isinstance(condition, Literal):
        return str(Literal(substitute_atom(condition.atom, bindings), condition.positive))
    return " and ".join(str(literal) for literal in literals(condition)) or "a condition"
