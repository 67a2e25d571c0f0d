"""Plan checker: says whether a partially ordered plan does what it claims, in every order.

It executes the steps in one order against the domain itself, verifies every causal link, and shows
that unordered steps cannot disturb each other. So every other order gives the same result. It
shares no code with grounding or search. Both use these parts of `kb`: terms and how they are
matched (`cellwright.kb.terms`), their arithmetic (`cellwright.kb.arithmetic`), what clingo derives
from the static rules (`cellwright.kb.asp`), and what a workflow means
(`cellwright.kb.model.planning_problem`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from cellwright.engine.model.workflow_replay import stage_atom
from cellwright.engine.stages.validation.chain_progress import ChainProgress
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.link_checks import CausalLinks
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.plan_claims import claimed_starts, false_claims
from cellwright.engine.stages.validation.step_changes import CheckedChange
from cellwright.engine.stages.validation.step_interference import ExecutedStep, StepInterference
from cellwright.engine.stages.validation.step_precedence import StepPrecedence
from cellwright.engine.stages.validation.time_checks import broken_times
from cellwright.kb.arithmetic import evaluate_term
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.conditions import And, Condition, Literal, literals_in
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.operator_amounts import NoAmount
from cellwright.kb.model.plan_model import (
    GOAL_STEP,
    INITIAL_STEP,
    CausalLink,
    Claims,
    Plan,
    Step,
    StepId,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Substitution, Term, substitute_atom, substitute_term

AMOUNT_FIELDS = ("duration", "cost")


def validate_plan(
    problem: Problem, plan: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """Everything that is wrong with a plan and with what is claimed of it; empty if it is valid."""
    return plan_findings(Semantics(problem), plan, name, claims)


def plan_findings(
    semantics: Semantics, plan: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """`validate` for the problem of a semantics, whose static facts may have been evaluated
    already.
    """
    return _Check(semantics, plan, Source(name)).run(claims)


class _Check:
    def __init__(self, semantics: Semantics, plan: Plan, where: Source) -> None:
        self.problem, self.plan, self.where = semantics.problem, plan, where
        self.semantics = semantics
        self.found: list[Diagnostic] = []
        self.executed: dict[StepId, ExecutedStep] = {}
        self.final = CheckerFacts()
        self.amounts: dict[StepId, tuple[int, int]] = {}

    def run(self, claims: Claims | None) -> list[Diagnostic]:
        if not self._well_formed():
            return self.found
        self.order = StepPrecedence(self.plan)
        if self._executes():
            self._reaches_goals()
            interference = self._interference()
            links = CausalLinks(interference, self.stages)
            self._report_all("K504", links.broken())
            self._check_stages(links)
            self._report_all("K503", interference.conflicts())
            if claims is not None:
                self._report_all("K504", links.idle())
                self._report_all("K508", self._held_more())
                self._report_all("K508", false_claims(self.problem, self._as_it_is(), claims))
                self._check_times(claims)
        return self.found

    def _check_times(self, claims: Claims) -> None:
        """Report the windows and calendars that the plan breaks at its times."""
        if not self.problem.all_windows and not self.problem.all_calendars:
            return
        plan, executed = self._as_it_is(), tuple(self.executed.values())
        starts = claimed_starts(plan, claims)
        for message, where in broken_times(self.problem, plan, starts, executed, self.start):
            self._report("K509", message, where)

    def _as_it_is(self) -> Plan:
        """The plan with the durations and costs that its steps really have; where it has no
        links, with those of its stages.
        """
        steps = tuple(
            replace(step, duration=self.amounts[step.id][0], cost=self.amounts[step.id][1])
            for step in self.plan.steps
        )
        links = self.plan.links or tuple(
            CausalLink(reached_stage.step, stage_atom(chain, number), GOAL_STEP)
            for chain in self.problem.chains
            for number, reached_stage in enumerate(self.stages.reached()[chain.name], 1)
        )
        return Plan(steps, links)

    def _report_all(self, code: str, messages: Iterable[str]) -> None:
        for message in messages:
            self._report(code, message)

    def _report(self, code: str, message: str, hint: str = "") -> None:
        self.found.append(Diagnostic(self.where, code, message, hint))

    def _well_formed(self) -> bool:
        """Whether step numbers are distinct and positive, and every step that is waited for or
        linked exists.
        """
        seen: set[StepId] = set()
        for step in self.plan.steps:
            for awaited in step.after:
                if awaited not in seen:
                    self._report(
                        "K505",
                        f"step {step.id} waits for {awaited}, which does not come before it in "
                        "the list",
                    )
            if step.id in seen or step.id <= 0:
                self._report("K507", f"step number {step.id} is used twice or not positive")
            seen.add(step.id)
        producers, consumers = seen | {INITIAL_STEP}, seen | {GOAL_STEP}
        for link in self.plan.links:
            if link.producer not in producers or link.consumer not in consumers:
                self._report(
                    "K504",
                    f"a link names a step that does not exist: {link.producer} to {link.consumer}",
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
                    "K506",
                    f"step {step.id} {step.operator}: {unexpected} is not the next stage of any "
                    "chain",
                )
                return False
            state = after
        self.final, self.stages = state, stages
        return True

    def _execute(self, step: Step, state: CheckerFacts) -> CheckedChange | None:
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
            text = f"step {step.id} {step.operator} both adds and denies {change.contradiction}"
            hint = (
                f"add conditions to {operator.name}, or to the deductive operators that it triggers"
            )
            self.found.append(Diagnostic(operator.where, "K301", text, hint))
            return None
        self.executed[step.id] = ExecutedStep(step, operator, bindings, change)
        return change

    def _amounts(self, step: Step, operator: Operator, bindings: Substitution) -> bool:
        """Whether a step exists: what it holds, how long it lasts and what it costs have values.

        Wrong claims are told.
        """
        try:
            resources, *numbers = self.semantics.demands(step.operator, operator, bindings)
        except NoAmount as error:
            self._report("K501", f"step {step.id} {step.operator}: {error}", error.hint)
            return False
        if None in resources:
            self._report(
                "K501", f"step {step.id} {step.operator}: a resource that it must hold has no value"
            )
            return False
        for name, value, claimed in zip(
            AMOUNT_FIELDS, numbers, (step.duration, step.cost), strict=True
        ):
            if value < 0:
                self._report("K501", f"step {step.id} {step.operator}: its {name} is {value}")
                return False
            if value != claimed:
                self._report(
                    "K508", f"step {step.id} {step.operator} has the {name} {value}, not {claimed}"
                )
        self.amounts[step.id] = numbers[0], numbers[1]
        if not set(resources) <= set(step.resources):
            self._report(
                "K501", f"step {step.id} {step.operator} must hold {_list_terms(resources)}"
            )
            return False
        return True

    def _held_more(self) -> Iterator[str]:
        """What a file says that steps hold, and the domain does not."""
        for executed in self.executed.values():
            own = [
                evaluate_term(substitute_term(resource, executed.bindings))
                for resource in executed.operator.resources
            ]
            if more := [resource for resource in executed.step.resources if resource not in own]:
                yield (
                    f"step {executed.step.id} {executed.step.operator} holds no {_list_terms(more)}"
                )

    def _unmet(
        self, step: Step, operator: Operator, bindings: Substitution, facts: CheckerFacts
    ) -> str | None:
        """The first part of a step's precondition that does not hold, written with its values."""
        failed = self.semantics.unmet(operator, step.operator, facts)
        return None if failed is None else _condition_text(failed, bindings)

    def _failed(
        self, condition: Condition, facts: CheckerFacts, bindings: Substitution
    ) -> Iterator[str]:
        """The conjuncts that do not hold, written with their values."""
        if isinstance(condition, And):
            for part in condition.parts:
                yield from self._failed(part, facts, bindings)
        elif not condition_holds(condition, facts, bindings):
            yield _condition_text(condition, bindings)

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

    def _check_stages(self, links: CausalLinks) -> None:
        for earlier, later, why in self.stages.orders():
            if earlier != later and not self.order.precedes(earlier, later):
                self._report("K506", f"steps {earlier} and {later} must be ordered: {why}")
        for name, reached in self.stages.reached().items():
            for reached_stage in reached:
                if reached_stage.held and not any(
                    links.lasts_until(atom, reached_stage.step) for atom in reached_stage.held
                ):
                    text = (
                        f"{reached_stage.stage} of {name} is reached when step "
                        f"{reached_stage.step} has come"
                    )
                    self._report("K506", f"{text}, but it may not hold then in every order")

    def _interference(self) -> StepInterference:
        return StepInterference(
            self.problem, self.plan, self.semantics, self.executed, self.order, self.start
        )


def _list_terms(terms: Iterable[Term | None]) -> str:
    return ", ".join(map(str, terms))


def _condition_text(condition: Condition, bindings: Substitution) -> str:
    if isinstance(condition, Literal):
        return str(Literal(substitute_atom(condition.atom, bindings), condition.positive))
    return " and ".join(str(literal) for literal in literals_in(condition)) or "a condition"
