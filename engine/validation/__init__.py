"""The checker: does a partially ordered plan do what it claims, in every order and overlap that it allows?

It executes one linearisation against the domain itself, verifies every causal link, and shows that unordered steps
cannot disturb each other, so that all other linearisations do the same. It shares no code with grounding or search.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from engine.validation.datalog import Bindings, Facts, holds
from engine.validation.semantics import Change, Semantics, State
from engine.validation.workflow import Stages
from kb.diagnostics import Diagnostic, Source
from kb.model.conditions import TRUE, And, Condition, Literal, bind, literals
from kb.model.domain import Operator
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import ANYTHING, Atom, Function, Substitution, match, substitute, substitute_atom, variables


def validate(problem: Problem, plan: Plan, name: str = "plan") -> list[Diagnostic]:
    """Everything that is wrong with a plan, in the order of its steps; empty if it is valid."""
    return _Check(problem, plan, Source(name)).run()


@dataclass(frozen=True, slots=True)
class Executed:
    """A step with what it did in the canonical order."""

    step: Step
    operator: Operator
    bindings: Bindings
    change: Change


@dataclass
class Reads:
    """What must not change beside a step: links are one-sided, watched patterns suffer from any change."""

    true: set[Atom] = field(default_factory=set)
    false: set[Atom] = field(default_factory=set)
    watched: set[Atom] = field(default_factory=set)


class _Check:
    def __init__(self, problem: Problem, plan: Plan, where: Source) -> None:
        self.problem, self.plan, self.where = problem, plan, where
        self.semantics = Semantics(problem)
        self.found: list[Diagnostic] = []
        self.executed: dict[StepId, Executed] = {}
        self.final: State = frozenset()

    def run(self) -> list[Diagnostic]:
        if not self._well_formed():
            return self.found
        self.before = self.plan.predecessors()
        if self._executes():
            self._reaches_goals()
            self._check_links()
            self._check_stages()
            self._check_interference()
        return self.found

    def _report(self, code: str, message: str, hint: str = "") -> None:
        self.found.append(Diagnostic(self.where, code, message, hint))

    def _well_formed(self) -> bool:
        """Steps have distinct numbers and wait only for steps before them."""
        seen: set[StepId] = set()
        for step in self.plan.steps:
            for other in step.after:
                if other not in seen:
                    self._report(
                        "K505", f"step {step.id} waits for {other}, which does not come before it in the list"
                    )
            if step.id in seen or step.id <= 0:
                self._report("K505", f"step number {step.id} is used twice or not positive")
            seen.add(step.id)
        known = seen | {START, GOAL}
        for link in self.plan.links:
            if link.producer not in known or link.consumer not in known:
                self._report(
                    "K504", f"a link names a step that does not exist: {link.producer} to {link.consumer}"
                )
        return not self.found

    def _executes(self) -> bool:
        state = self.semantics.initial()
        stages = Stages(self.problem.domain, self.problem.chains)
        self.start = state
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
            state = (state - change.ends) | change.adds
        self.final, self.stages = state, stages
        return True

    def _execute(self, step: Step, state: State) -> Change | None:
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
            if not _is_stage(link.condition):
                self._check_link(link)

    def _check_link(self, link: CausalLink) -> None:
        said = f"link {link.producer} to {link.consumer} for {link.condition}"
        atom, positive = _signed(link.condition)
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
        for executed in self.executed.values():
            other = executed.step.id
            if other in (link.producer, link.consumer) or not self._destroys(executed, atom, positive):
                continue
            early = link.producer != START and other in self.before[link.producer]
            late = link.consumer != GOAL and link.consumer in self.before[other]
            if not early and not late:
                self._report(
                    "K504", f"{said}: step {other} {executed.step.operator} can come between and end it"
                )
                return

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
        return atom not in executed.change.adds and self._denies(executed, atom)

    def _denies(self, executed: Executed, atom: Atom) -> bool:
        return any(denial.matches(atom, self.semantics.statics) for denial in executed.change.denials)

    def _check_interference(self) -> None:
        """No two unordered steps may disturb each other, since they may come in either order or overlap."""
        steps = list(self.executed.values())
        reads: dict[StepId, Reads] = {}
        for position, one in enumerate(steps):
            for other in steps[:position]:
                if other.step.id in self.before[one.step.id]:
                    continue
                for each in (one, other):
                    if each.step.id not in reads:
                        reads[each.step.id] = self._reads(each)
                problem = self._conflict(one, other, reads) or self._conflict(other, one, reads)
                if problem:
                    self._report(
                        "K503", f"steps {other.step.id} and {one.step.id} are unordered, but {problem}"
                    )

    def _conflict(self, one: Executed, other: Executed, reads: dict[StepId, Reads]) -> str:
        """How `one` disturbs `other`, or nothing."""
        shared = set(one.step.resources) & set(other.step.resources)
        if shared:
            return f"both hold {min(map(str, shared))}"
        needed = reads[other.step.id]
        name = f"{one.step.operator}"
        for atom in sorted(needed.true | set(other.change.adds), key=str):
            if atom not in one.change.adds and self._denies(one, atom):
                return f"{name} denies {atom}, which {other.step.operator} needs or adds"
        for atom in sorted(needed.false & one.change.adds, key=str):
            return f"{name} adds {atom}, which {other.step.operator} needs false"
        for pattern in sorted(needed.watched, key=str):
            changed = (*one.change.adds, *one.change.ends)
            if any(match(pattern, atom, {}) is not None for atom in changed):
                return f"{name} changes {pattern}, which {other.step.operator} depends on"
        return ""

    def _reads(self, executed: Executed) -> Reads:
        """Causal links where they prove the precondition; else everything that it mentions."""
        reads = Reads(watched=set(executed.change.triggered))
        for link in self.plan.links:
            if link.consumer == executed.step.id and not _is_stage(link.condition):
                atom, positive = _signed(link.condition)
                (reads.true if positive else reads.false).add(atom)
        conditions = [executed.operator.precondition]
        conditions += [e.condition for e in executed.operator.effects if e.condition != TRUE or e.parameters]
        reads.watched -= reads.true
        bindings = executed.bindings
        for condition in conditions:
            if condition is not executed.operator.precondition or not self._proved(
                condition, bindings, reads
            ):
                reads.watched |= set(self._mentioned(condition, bindings))
        return reads

    def _proved(self, condition: Condition, bindings: Bindings, reads: Reads) -> bool:
        """Whether what the links guarantee makes the condition true in every state that agrees with them."""
        lower, upper = self.semantics.bounds(reads.true, self.everything - reads.false)
        return holds(condition, lower, bindings, upper)

    @cached_property
    def everything(self) -> State:
        """Every atom that is true at some time."""
        return self.start.union(*(executed.change.adds for executed in self.executed.values()))

    def _mentioned(self, condition: Condition, bindings: Bindings) -> Iterator[Atom]:
        """The fluent atoms, or patterns of them, on which a condition can depend."""
        for literal in literals(bind(condition, bindings)):
            atom = literal.atom
            fluents = self.semantics.fluents_behind(atom.name)
            if fluents == {atom.name}:
                yield substitute_atom(atom, dict.fromkeys(variables(atom), ANYTHING))
            else:
                yield from (atom_pattern(self.problem, name) for name in sorted(fluents))


def atom_pattern(problem: Problem, name: str) -> Atom:
    """Any atom of a predicate."""
    return Function(name, (ANYTHING,) * len(problem.domain.predicates[name].arguments))


def _signed(condition: Atom) -> tuple[Atom, bool]:
    if (
        condition.name == "not"
        and len(condition.arguments) == 1
        and isinstance(condition.arguments[0], Function)
    ):
        return condition.arguments[0], False
    return condition, True


def _is_stage(condition: Atom) -> bool:
    return _signed(condition)[0].name == "_stage"


def _said(condition: Condition, bindings: Substitution) -> str:
    if isinstance(condition, Literal):
        return str(Literal(substitute_atom(condition.atom, bindings), condition.positive))
    return " and ".join(str(literal) for literal in literals(condition)) or "a condition"
