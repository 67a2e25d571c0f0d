"""The checker: does a partially ordered plan do what it claims, in every order and overlap that it allows?

It executes the steps in one order against the domain itself, verifies every causal link, and shows that
unordered steps cannot disturb each other. So every other order gives the same result. It shares no code with
grounding or search. Both use these parts of `kb`: terms and how they are matched (`cellwright.kb.terms`), their
arithmetic (`cellwright.kb.arithmetic`), what clingo derives from the static rules (`cellwright.kb.asp`), and what a workflow means
(`cellwright.kb.model.workflow`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from cellwright.engine.model.stages import stage_atom
from cellwright.engine.stages.validation.changes import StepChange
from cellwright.engine.stages.validation.claims import false_claims
from cellwright.engine.stages.validation.datalog import holds
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.interference import Executed, Interference
from cellwright.engine.stages.validation.links import Links
from cellwright.engine.stages.validation.precedence import Precedence
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.engine.stages.validation.workflow import ChainProgress
from cellwright.kb.arithmetic import evaluate
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.amounts import NoAmount
from cellwright.kb.model.conditions import And, Condition, Literal, literals
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.plan import GOAL, START, CausalLink, Claims, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Substitution, Term, substitute, substitute_atom

AMOUNTS = ("duration", "cost")


def validate(
    problem: Problem, plan: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """Everything that is wrong with a plan and with what is claimed of it; empty if it is valid."""
    return findings(Semantics(problem), plan, name, claims)


def findings(
    semantics: Semantics, plan: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """`validate` for the problem of a semantics, whose static facts may have been evaluated already."""
    return _Check(semantics, plan, Source(name)).run(claims)


class _Check:
    def __init__(self, semantics: Semantics, plan: Plan, where: Source) -> None:
        self.problem, self.plan, self.where = semantics.problem, plan, where
        self.semantics = semantics
        self.found: list[Diagnostic] = []
        self.executed: dict[StepId, Executed] = {}
        self.final = Facts()
        self.amounts: dict[StepId, tuple[int, int]] = {}

    def run(self, claims: Claims | None) -> list[Diagnostic]:
        if not self._well_formed():
            return self.found
        self.order = Precedence(self.plan)
        if self._executes():
            self._reaches_goals()
            interference = self._interference()
            links = Links(interference, self.stages)
            self._report_all("K504", links.broken())
            self._check_stages(links)
            self._report_all("K503", interference.conflicts())
            if claims is not None:
                self._report_all("K504", links.idle())
                self._report_all("K508", self._held_more())
                self._report_all("K508", false_claims(self.problem, self._as_it_is(), claims))
        return self.found

    def _as_it_is(self) -> Plan:
        """The plan with the durations and costs that its steps really have; where it has no links, with those of its stages."""
        steps = tuple(
            replace(each, duration=self.amounts[each.id][0], cost=self.amounts[each.id][1])
            for each in self.plan.steps
        )
        links = self.plan.links or tuple(
            CausalLink(each.step, stage_atom(chain, number), GOAL)
            for chain in self.problem.chains
            for number, each in enumerate(self.stages.reached()[chain.name], 1)
        )
        return Plan(steps, links)

    def _report_all(self, code: str, messages: Iterable[str]) -> None:
        for message in messages:
            self._report(code, message)

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
        producers, consumers = seen | {START}, seen | {GOAL}
        for link in self.plan.links:
            if link.producer not in producers or link.consumer not in consumers:
                self._report(
                    "K504", f"a link names a step that does not exist: {link.producer} to {link.consumer}"
                )
        return not self.found

    def _executes(self) -> bool:
        self.start = self.semantics.initial()
        state = self.semantics.layer(self.start)
        stages = ChainProgress(self.problem.domain, self.problem.chains, state)
        for step in self.plan.steps:
            change = self._execute(step, state)
            if change is None:
                return False
            after = state.after(change.ends, change.adds)
            unexpected = stages.step(step.id, change.events, change.adds, after)
            if unexpected is not None:
                self._report(
                    "K506", f"step {step.id} {step.operator}: {unexpected} is not the next stage of any chain"
                )
                return False
            state = after
        self.final, self.stages = state, stages
        return True

    def _execute(self, step: Step, state: Facts) -> StepChange | None:
        bound = self.semantics.binding(step.operator)
        if isinstance(bound, str):
            self._report("K501", f"step {step.id} {step.operator}: {bound}")
            return None
        operator, bindings = bound
        if not self._amounts(step, operator, bindings):
            return None
        facts = self.semantics.facts(state)
        failed = self._unmet(step, operator, bindings, facts)
        if failed is not None:
            self._report(
                "K501",
                f"step {step.id} {step.operator}: {failed} does not hold when it starts",
                self._why(failed),
            )
            return None
        change = self.semantics.change(operator, bindings, facts, state)
        if change.contradiction is not None:
            said = f"step {step.id} {step.operator} both adds and denies {change.contradiction}"
            hint = f"add conditions to {operator.name}, or to the deductive operators that it triggers"
            self.found.append(Diagnostic(operator.where, "K301", said, hint))
            return None
        self.executed[step.id] = Executed(step, operator, bindings, change)
        return change

    def _amounts(self, step: Step, operator: Operator, bindings: Substitution) -> bool:
        """Whether a step exists: what it holds, how long it lasts and what it costs have values. Wrong claims are told."""
        try:
            held, *numbers = self.semantics.demands(step.operator, operator, bindings)
        except NoAmount as error:
            self._report("K501", f"step {step.id} {step.operator}: {error}", error.hint)
            return False
        if None in held:
            self._report("K501", f"step {step.id} {step.operator}: a resource that it must hold has no value")
            return False
        for name, value, claimed in zip(AMOUNTS, numbers, (step.duration, step.cost), strict=True):
            if value < 0:
                self._report("K501", f"step {step.id} {step.operator}: its {name} is {value}")
                return False
            if value != claimed:
                self._report("K508", f"step {step.id} {step.operator} has the {name} {value}, not {claimed}")
        self.amounts[step.id] = numbers[0], numbers[1]
        if not set(held) <= set(step.resources):
            self._report("K501", f"step {step.id} {step.operator} must hold {_listed(held)}")
            return False
        return True

    def _held_more(self) -> Iterator[str]:
        """What a file says that steps hold, and the domain does not."""
        for each in self.executed.values():
            own = [evaluate(substitute(resource, each.bindings)) for resource in each.operator.resources]
            if more := [resource for resource in each.step.resources if resource not in own]:
                yield f"step {each.step.id} {each.step.operator} holds no {_listed(more)}"

    def _unmet(self, step: Step, operator: Operator, bindings: Substitution, facts: Facts) -> str | None:
        """The first part of a step's precondition that does not hold, written with its values."""
        failed = self.semantics.unmet(operator, step.operator, facts)
        return None if failed is None else _said(failed, bindings)

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
        for stage in self.stages.missing():
            self._report("K506", f"the workflow misses {stage}")

    def _check_stages(self, links: Links) -> None:
        for earlier, later, why in self.stages.orders():
            if earlier != later and not self.order.precedes(earlier, later):
                self._report("K506", f"steps {earlier} and {later} must be ordered: {why}")
        for name, reached in self.stages.reached().items():
            for each in reached:
                if each.held and not any(links.lasts_until(atom, each.step) for atom in each.held):
                    said = f"{each.stage} of {name} is reached when step {each.step} has come"
                    self._report("K506", f"{said}, but it may not hold then in every order")

    def _interference(self) -> Interference:
        return Interference(self.problem, self.plan, self.semantics, self.executed, self.order, self.start)


def _listed(terms: Iterable[Term | None]) -> str:
    return ", ".join(map(str, terms))


def _said(condition: Condition, bindings: Substitution) -> str:
    if isinstance(condition, Literal):
        return str(Literal(substitute_atom(condition.atom, bindings), condition.positive))
    return " and ".join(str(literal) for literal in literals(condition)) or "a condition"
