"""What it takes to bring about the preconditions of tests and repairs: plans, and the states in which they leave the cell."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.troubleshooting import Setup
from cellwright.engine.pipelines import planning
from cellwright.engine.stages.diagnosis.revision import Binding, bound
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.validation.datalog import holds
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import And, Condition, Exists, Literal, Parameter
from cellwright.kb.model.domain import OBJECT, Domain
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable

FAR = 1e6  # seconds: what cannot be brought about from where an earlier test has led
WORK = Limits(expansions=20_000, improvement=0)

State = frozenset[Atom]


@dataclass
class Preparations:
    """What bringing about the preconditions of tests and repairs costs, from the present state and from each other."""

    problem: Problem
    binding: Binding = field(default_factory=dict)
    limits: Limits = WORK
    plans: dict[tuple[State, Condition], Plan | None] = field(default_factory=dict)
    states: list[State] = field(default_factory=list)  # the situations by number, which stay when others join

    @cached_property
    def semantics(self) -> Semantics:
        """What the steps of the problem mean."""
        return Semantics(self.problem)

    def __call__(self, preconditions: Sequence[tuple[Atom, ...]]) -> Setup:
        """The situations: the present one, and after preparing each of the conditions in turn.

        Cost i, j is the duration of the steps of a plan from situation i to the preconditions of action j; infinite
        from the present one where there is none.
        """
        goals = [self.goal(each) for each in preconditions]
        if not self.states:
            self.states.append(self.semantics.initial())
        for goal in dict.fromkeys(goals):
            reached = self._after(self.states[0], goal)
            if reached is not None and reached not in self.states:
                self.states.append(reached)
        costs, following = [], []
        for state in self.states:
            price = [self._cost(state, goal) for goal in goals]
            costs.append(tuple(price if state is self.states[0] else [min(each, FAR) for each in price]))
            following.append(tuple(self._situation(state, goal) for goal in goals))
        return Setup(tuple(costs), tuple(following))

    def plan_from(self, state: State, goal: Condition) -> Plan | None:
        """The plan from a state to a condition; None if there is none within the limits."""
        key = (state, goal)
        if key not in self.plans and holds(goal, self.semantics.facts(state), {}):
            self.plans[key] = Plan(())
        if key not in self.plans:
            ordered = tuple(sorted(state, key=str))
            asked = replace(self.problem.replace(ordered), goal=goal, chains=())
            outcome = planning.plan(asked, self.limits)
            self.plans[key] = outcome.plan if isinstance(outcome, Found) else None
        return self.plans[key]

    def goal(self, preconditions: Iterable[Atom]) -> Condition:
        """The condition: what the interrupted step does not bind is some object of its type."""
        atoms = bound(preconditions, self.binding)
        types: dict[Variable, str] = {}
        for atom in atoms:
            _infer(atom, self.problem.domain.predicates[atom.name].arguments, self.problem.domain, types)
        goal = And(tuple(Literal(atom) for atom in atoms))
        return Exists(tuple(Parameter(v, t) for v, t in types.items()), goal) if types else goal

    def _situation(self, state: State, goal: Condition) -> int:
        """Where preparing a goal leads; what a plan leaves otherwise is taken for what it leaves from the present state."""
        for reached in (self._after(state, goal), self._after(self.states[0], goal)):
            if reached in self.states:
                return self.states.index(reached)
        return 0

    def _cost(self, state: State, goal: Condition) -> float:
        made = self.plan_from(state, goal)
        if made is None:
            return FAR if self.limits.interrupted() else math.inf
        return float(sum(step.duration for step in made.steps))

    def _after(self, state: State, goal: Condition) -> State | None:
        made = self.plan_from(state, goal)
        return None if made is None else after(self.problem, state, made)


def after(problem: Problem, state: State, plan: Plan) -> State:
    """The state that the steps of a plan lead to, by the semantics of the independent checker."""
    semantics = Semantics(problem)
    for step in plan.steps:
        found = semantics.binding(step.operator)
        if isinstance(found, str):
            raise ValueError(found)
        change = semantics.change(*found, semantics.facts(state), state)
        state = frozenset((state - change.ends) | change.adds)
    return state


def _infer(term: Term, expected: Sequence[str], domain: Domain, types: dict[Variable, str]) -> None:
    """Types of the variables in a term's arguments, from signatures; the narrower one counts."""
    if not isinstance(term, Function):
        return
    for argument, type_ in zip(term.arguments, expected, strict=True):
        if isinstance(argument, Variable):
            known = types.get(argument, OBJECT)
            types[argument] = type_ if domain.is_subtype(type_, known) else known
        elif isinstance(argument, Function) and argument.name in domain.functions:
            _infer(argument, domain.functions[argument.name].arguments, domain, types)
