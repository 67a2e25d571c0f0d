"""Beliefs in an open case: a state for each hypothesis, and plans that prepare its tests."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.troubleshooting import CaseHypothesis, PreparationSteps, Setup
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery import FaultyCell, WorldState
from cellwright.engine.stages.diagnosis.belief_revision import Binding, bind_atoms
from cellwright.engine.stages.diagnosis.case_session import CaseSession
from cellwright.engine.stages.diagnosis.fault_problems import CURED
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import And, Condition, Exists, Literal, Parameter
from cellwright.kb.model.domain_model import OBJECT_TYPE, Domain
from cellwright.kb.model.fault_model import FaultTest, Repair
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable

UNREACHABLE_COST_S = 1e6  # seconds: what cannot be brought about from where an earlier test has led
PREPARATION_LIMITS = SearchLimits(expansions=20_000, improvement=0)

State = frozenset[Atom]


@dataclass
class Preparations:
    """What bringing about the preconditions of tests and repairs costs, from the present state
    and from each other.
    """

    problem: Problem
    binding: Binding = field(default_factory=dict)
    limits: SearchLimits = PREPARATION_LIMITS
    plans: dict[tuple[State, Condition], Plan | None] = field(default_factory=dict)
    # the situations by number, which stay when others join
    states: list[State] = field(default_factory=list)

    @cached_property
    def semantics(self) -> Semantics:
        """What the steps of the problem mean."""
        return Semantics(self.problem)

    def __call__(self, preconditions: Sequence[tuple[Atom, ...]]) -> Setup:
        """The situations: the present one, and after preparing each of the conditions in turn.

        Cost i, j is the duration of the steps of a plan from situation i to the preconditions of
        action j; infinite from the present one where there is none.
        """
        goals = [self.goal(precondition) for precondition in preconditions]
        if not self.states:
            self.states.append(self.semantics.initial())
        for goal in dict.fromkeys(goals):
            reached = self._after(self.states[0], goal)
            if reached is not None and reached not in self.states:
                self.states.append(reached)
        costs, following = [], []
        for state in self.states:
            price = [self._cost(state, goal) for goal in goals]
            costs.append(
                tuple(
                    price
                    if state is self.states[0]
                    else [min(cost, UNREACHABLE_COST_S) for cost in price]
                )
            )
            following.append(tuple(self._situation(state, goal) for goal in goals))
        return Setup(tuple(costs), tuple(following))

    def plan_from(self, state: State, goal: Condition) -> Plan | None:
        """The plan from a state to a condition; None if there is none within the limits."""
        key = (state, goal)
        if key not in self.plans and condition_holds(goal, self.semantics.facts(state), {}):
            self.plans[key] = Plan(())
        if key not in self.plans:
            ordered = tuple(sorted(state, key=str))
            asked = replace(self.problem.replace(ordered), goal=goal, chains=())
            outcome = checked_plan.plan_problem(asked, self.limits)
            self.plans[key] = outcome.plan if isinstance(outcome, Found) else None
        return self.plans[key]

    def goal(self, preconditions: Iterable[Atom]) -> Condition:
        """The condition: what the interrupted step does not bind is some object of its type."""
        atoms = bind_atoms(preconditions, self.binding)
        types: dict[Variable, str] = {}
        for atom in atoms:
            _infer_types(
                atom,
                self.problem.domain.predicates[atom.name].arguments,
                self.problem.domain,
                types,
            )
        goal = And(tuple(Literal(atom) for atom in atoms))
        return Exists(tuple(Parameter(v, t) for v, t in types.items()), goal) if types else goal

    def _situation(self, state: State, goal: Condition) -> int:
        """Where preparing a goal leads; what a plan leaves otherwise is taken for what it
        leaves from the present state.
        """
        for reached in (self._after(state, goal), self._after(self.states[0], goal)):
            if reached in self.states:
                return self.states.index(reached)
        return 0

    def _cost(self, state: State, goal: Condition) -> float:
        plan_made = self.plan_from(state, goal)
        if plan_made is None:
            return UNREACHABLE_COST_S if self.limits.interrupted() else math.inf
        return float(sum(step.duration for step in plan_made.steps))

    def _after(self, state: State, goal: Condition) -> State | None:
        plan_made = self.plan_from(state, goal)
        return None if plan_made is None else state_after(self.problem, state, plan_made)


def state_after(problem: Problem, state: State, plan: Plan) -> State:
    """The state that the steps of a plan lead to, by the semantics of the independent checker."""
    semantics = Semantics(problem)
    for step in plan.steps:
        bound_operator = semantics.binding(step.operator)
        if isinstance(bound_operator, str):
            raise ValueError(bound_operator)
        change = semantics.change(*bound_operator, semantics.facts(state), state)
        state = frozenset((state - change.ends) | change.adds)
    return state


def _infer_types(
    term: Term, expected: Sequence[str], domain: Domain, types: dict[Variable, str]
) -> None:
    """Types of the variables in a term's arguments, from signatures; the narrower one counts."""
    if not isinstance(term, Function):
        return
    for argument, type_ in zip(term.arguments, expected, strict=True):
        if isinstance(argument, Variable):
            known_type = types.get(argument, OBJECT_TYPE)
            types[argument] = type_ if domain.is_subtype(type_, known_type) else known_type
        elif isinstance(argument, Function) and argument.name in domain.functions:
            _infer_types(argument, domain.functions[argument.name].arguments, domain, types)


Causes = tuple[str, ...]
Bars = tuple[tuple[str, ...], tuple[Function, ...]]  # what is lost, and what fails
NO_CAUSES: Causes = ()


@dataclass
class CaseBeliefs:
    """The states of a cell under each hypothesis. `before` is the state in which the interrupted
    step began.

    `deeds` are the steps that were taken for tests and repairs; a repair that helped comes last.
    """

    cell: FaultyCell
    before: WorldState
    preparations: Preparations
    deeds: list[Function] = field(default_factory=list)
    helped: Repair | None = None
    _known: dict[Causes, tuple[int, WorldState]] = field(default_factory=dict)
    _without: dict[Bars, Preparations] = field(default_factory=dict)

    def state(self, causes: Causes) -> WorldState:
        """The state if these are the causes, after everything that was done."""
        count, state = self._known.get(causes) or (0, self.cell.begun(self.before, causes))
        for step in self.deeds[count:]:
            state = self.cell.taken(state, causes, step)
        self._known[causes] = (len(self.deeds), state)
        return self.cell.cured(state, self.helped) if self.helped else state

    def common(self, hypotheses: Iterable[CaseHypothesis]) -> WorldState:
        """What is sure if one of some hypotheses is true."""
        states = [
            self.state(causes)
            for causes in dict.fromkeys(hypothesis.causes for hypothesis in hypotheses)
        ]
        return reduce(WorldState.common, states) if states else self.state(NO_CAUSES)

    def prepare(self, session: CaseSession, action: str) -> PreparationSteps | None:
        """The steps that bring about what an action needs, whatever the cause is; else if it is the
        most probable one.

        None if there is no plan for it that the causes leave to be taken.
        """
        goal = self.preparations.goal(self._action(action).preconditions)
        believed = [hypothesis for hypothesis, _ in session.belief()]
        for among in (believed, believed[:1]):
            plan = self._spared(among).plan_from(self.common(among).facts, goal)
            if plan is not None:
                return _as_prepared(plan)
        return None

    def _spared(self, among: Sequence[CaseHypothesis]) -> Preparations:
        """The preparations that take no step which fails under one of some hypotheses."""
        causes = tuple(dict.fromkeys(cause for hypothesis in among for cause in hypothesis.causes))
        lost = tuple(sorted({str(term) for cause in causes for term in self.cell.lost(cause)}))
        blocked = tuple(
            dict.fromkeys(step for cause in causes for step in self.cell.blocked(cause))
        )
        if not lost and not blocked:
            return self.preparations
        if (lost, blocked) not in self._without:
            problem = forbid_steps(self.preparations.problem, lost, blocked)
            self._without[lost, blocked] = replace(
                self.preparations, problem=problem, plans={}, states=[]
            )
        return self._without[lost, blocked]

    def repaired(
        self, session: CaseSession, repair: str
    ) -> "tuple[CaseBeliefs, PreparationSteps] | None":
        """What would be believed after a repair that helps, and the steps that prepare it; None
        if it cannot be prepared.
        """
        prepared = self.prepare(session, repair)
        if prepared is None:
            return None
        later = replace(self, deeds=list(self.deeds), _known=dict(self._known))
        later.carried_out(repair, CURED, prepared)
        return later, prepared

    def carried_out(self, action: str, outcome: str, prepared: PreparationSteps) -> None:
        """Take in the steps that prepared an action, the step that did it, and the repair if it
        helped.
        """
        self.deeds += [step.operator for step in prepared.steps]
        done = self._action(action)
        step = self.cell.carried_out_by(done)
        self.deeds += [step] if step is not None else []
        if isinstance(done, Repair) and outcome == CURED:
            self.helped = done

    def _action(self, name: str) -> FaultTest | Repair:
        return self.cell.model.tests.get(name) or self.cell.model.repairs[name]


def _as_prepared(plan: Plan) -> PreparationSteps:
    return PreparationSteps(plan.steps, float(sum(step.duration for step in plan.steps)))
