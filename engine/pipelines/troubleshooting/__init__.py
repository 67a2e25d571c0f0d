"""Diagnosis with planning: plans give the set-up costs of tests, and the planner continues after the diagnosis.

The exception handler asks two kinds of questions: "what does it take to do this test now?" and "how does the work go on?".
Here the planner answers them.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from engine.model.cases import Diagnosis, Revision
from engine.model.outcome import Found
from engine.model.troubleshooting import Setup
from engine.pipelines import planning
from engine.pipelines.troubleshooting.given import Failed, left_of, read_step
from engine.pipelines.troubleshooting.recovery import Recovery, recover, told
from engine.stages.diagnosis.exact import Interrupted, never
from engine.stages.diagnosis.knowledge import Objective, no_setup
from engine.stages.diagnosis.revision import Binding, binding_of, bound, certainties, revision
from engine.stages.diagnosis.selection import EXPANSIONS
from engine.stages.diagnosis.session import Session
from engine.stages.planning import Limits
from engine.stages.validation.datalog import holds
from engine.stages.validation.semantics import Semantics
from kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from kb.loader import find, load
from kb.loader.faults import load_faults
from kb.model.conditions import And, Condition, Exists, Literal, Parameter
from kb.model.domain import OBJECT, Domain
from kb.model.faults import FaultModel
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.store.cases import Cases, ClosedCase, counts
from kb.terms import Atom, Function, Term, Variable

__all__ = ["Desk", "Preparations", "Recovery", "after", "desk", "fault_model", "recover"]

FAR = 1e6  # seconds: the cost of preconditions that cannot be achieved after an earlier test
WORK = Limits(expansions=20_000, improvement=0)

State = frozenset[Atom]


@dataclass
class Preparations:
    """The cost of achieving the preconditions of tests and repairs, from the present state and from each other."""

    problem: Problem
    binding: Binding = field(default_factory=dict)
    limits: Limits = WORK
    plans: dict[tuple[State, Condition], Plan | None] = field(default_factory=dict)
    states: list[State] = field(default_factory=list)  # by number, which stays when others are appended

    def __call__(self, preconditions: Sequence[tuple[Atom, ...]]) -> Setup:
        """The costs of preparing actions, and the situations to which the preparations lead.

        Situation 0 is the present one. The others are reached from it by preparing one action. Cost i, j is the duration,
        in seconds, of the steps of a plan from situation i to the preconditions of action j. If there is no plan, the cost
        is infinite from the present situation, and `FAR` from the others.
        """
        goals = [self.goal(each) for each in preconditions]
        if not self.states:
            self.states.append(frozenset(Semantics(self.problem).initial()))
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

    def plan_for(self, preconditions: tuple[Atom, ...]) -> Plan | None:
        """A plan from the present state to the preconditions of an action; None if there is none."""
        present = self.states[0] if self.states else frozenset(Semantics(self.problem).initial())
        return self._plan(present, self.goal(preconditions))

    def goal(self, preconditions: Iterable[Atom]) -> Condition:
        """The preconditions as a goal. A variable that the interrupted step leaves open is some object of its type."""
        atoms = bound(preconditions, self.binding)
        types: dict[Variable, str] = {}
        for atom in atoms:
            _infer(atom, self.problem.domain.predicates[atom.name].arguments, self.problem.domain, types)
        goal = And(tuple(Literal(atom) for atom in atoms))
        return Exists(tuple(Parameter(v, t) for v, t in types.items()), goal) if types else goal

    def _situation(self, state: State, goal: Condition) -> int:
        """The number of the situation to which preparing a goal leads.

        A plan from another situation may end in a state that has no number. Then the situation that a plan from the present
        state leads to is taken instead.
        """
        for reached in (self._after(state, goal), self._after(self.states[0], goal)):
            if reached in self.states:
                return self.states.index(reached)
        return 0

    def _cost(self, state: State, goal: Condition) -> float:
        made = self._plan(state, goal)
        return math.inf if made is None else float(sum(step.duration for step in made.steps))

    def _after(self, state: State, goal: Condition) -> State | None:
        made = self._plan(state, goal)
        return None if made is None else after(self.problem, state, made)

    def _plan(self, state: State, goal: Condition) -> Plan | None:
        key = (state, goal)
        if key not in self.plans and holds(goal, Semantics(self.problem).facts(state), {}):
            self.plans[key] = Plan(())
        if key not in self.plans:
            ordered = tuple(sorted(state, key=str))
            asked = replace(self.problem.replace(ordered), goal=goal, chains=())
            outcome = planning.plan(asked, self.limits)
            self.plans[key] = outcome.plan if isinstance(outcome, Found) else None
        return self.plans[key]


def after(problem: Problem, state: State, plan: Plan) -> State:
    """The state after the steps of a plan, by the semantics of the independent checker."""
    semantics = Semantics(problem)
    for step in plan.steps:
        found = semantics.binding(step.operator)
        if isinstance(found, str):
            raise ValueError(found)
        change = semantics.change(*found, semantics.facts(state), state)
        state = frozenset((state - change.ends) | change.adds)
    return state


def _infer(term: Term, expected: Sequence[str], domain: Domain, types: dict[Variable, str]) -> None:
    """Add to `types` the types of the variables in a term, from signatures. The narrower of two types is kept."""
    if not isinstance(term, Function):
        return
    for argument, type_ in zip(term.arguments, expected, strict=True):
        if isinstance(argument, Variable):
            known = types.get(argument, OBJECT)
            types[argument] = type_ if domain.is_subtype(type_, known) else known
        elif isinstance(argument, Function) and argument.name in domain.functions:
            _infer(argument, domain.functions[argument.name].arguments, domain, types)


@dataclass
class Desk:
    """A case and what belongs to it: the fault base, the problem in which it happened, and the bindings of the step."""

    model: FaultModel
    session: Session
    binding: Binding
    problem: Problem | None = None
    left: Plan | None = None  # the steps of the failed plan that were not done

    def says(self, name: str) -> str:
        """The wording of a test or a repair for people; empty if it has none."""
        found = self.model.tests.get(name) or self.model.repairs.get(name)
        return found.say if found else ""

    def certainties(self, made: Diagnosis) -> dict[Atom, float]:
        """The certainty, from 0 to 1, of each assertion that some cause puts in doubt."""
        return certainties(self.model, made.hypotheses, self.binding)

    def revision(self, made: Diagnosis) -> Revision:
        """The changes to the world model that follow from the case."""
        repaired = made.cured if made.cured in self.model.repairs else None
        return revision(self.model, made, self.binding, repaired)

    def recover(self, change: Revision, store: str = "") -> Recovery:
        """Plan the rest of the work. A kept sequence of the problem is updated by what was lost.

        Raises `InvalidInput` without a problem.
        """
        if self.problem is None:
            hint = "give a problem as the target, because a plan needs its goals"
            raise InvalidInput([Diagnostic(Source("--recover"), "K404", "a domain has no goals", hint)])
        found = recover(self.problem, change, left=self.left)
        return told(found, self.problem, change.lost, store) if store else found

    def keep(self, made: Diagnosis, store: str) -> None:
        """Store the case as closed if its cause is known."""
        causes = made.hypotheses[0][0].causes if made.isolated and made.hypotheses else ()
        if causes:
            seen = tuple((each.action, each.outcome) for each in made.observations)
            with Cases(store) as cases:
                cases.add([ClosedCase(self.model.domain, made.exception, causes, made.cost, seen)])


def desk(
    target: str,
    exception: str,
    step: str = "",
    objective: str = "isolate",
    store: str = "",
    expansions: int = EXPANSIONS,
    interrupted: Interrupted = never,
    failed: Failed | None = None,
) -> Desk:
    """Open a case. Raises `InvalidInput`.

    If the target is a problem, set-up costs are planned in it. If it is a domain, there are none. If `failed` names the
    plan that failed, set-up and recovery begin where that plan was interrupted.
    """
    loaded = load(find(target))
    problem, left = left_of(loaded, failed) if failed else (loaded.problem, None)
    model, _ = load_faults(Path(loaded.domain.path))
    if exception not in model.exceptions:
        raise InvalidInput([unknown_name("exception", exception, model.exceptions, Source("--exception"))])
    binding = binding_of(model, exception, read_step(step, loaded, model.exceptions[exception]))
    setup = Preparations(problem, binding) if problem else no_setup
    counted = model.exceptions[exception].counts
    if store:
        with Cases(store) as cases:
            counted = counts(counted, cases.history(model.domain, exception))
    session = Session(model, exception, Objective(objective), counted, setup, expansions, interrupted)
    return Desk(model, session, binding, problem, left)


def fault_model(target: str) -> FaultModel:
    """The fault base of a target. Raises `InvalidInput`."""
    return load_faults(Path(load(find(target)).domain.path))[0]
