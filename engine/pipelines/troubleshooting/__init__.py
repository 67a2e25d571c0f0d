"""Where diagnosis meets planning: set-up costs are plans, and what was found out goes back to the planner.

Here the exception handler's questions ("what does it take to do this test now?", "how do we go on?") are put to the planner.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from engine.kernels.cancellation import Interrupted, never
from engine.model.cases import Diagnosis, Revision
from engine.model.outcome import Found
from engine.model.troubleshooting import Setup
from engine.pipelines import planning
from engine.pipelines.troubleshooting.given import Failed, left_of, read_step
from engine.pipelines.troubleshooting.recovery import Recovery, recover, told
from engine.stages.diagnosis.knowledge import Objective, no_setup
from engine.stages.diagnosis.revision import Binding, binding_of, bound, certainties, revision
from engine.stages.diagnosis.session import Session
from engine.stages.planning import Limits
from engine.stages.validation.datalog import holds
from engine.stages.validation.semantics import Semantics
from kb.check.faults import too_many
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

    def __call__(self, preconditions: Sequence[tuple[Atom, ...]]) -> Setup:
        """The situations: the present one, and after preparing each of the conditions in turn.

        Cost i, j is the duration of the steps of a plan from situation i to the preconditions of action j; infinite
        from the present one where there is none.
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
        """The plan that prepares an action from the present state; None if there is none."""
        present = self.states[0] if self.states else frozenset(Semantics(self.problem).initial())
        return self._plan(present, self.goal(preconditions))

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
        made = self._plan(state, goal)
        if made is None:
            return FAR if self.limits.interrupted() else math.inf
        return float(sum(step.duration for step in made.steps))

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


@dataclass
class Desk:
    """One case with everything around it: the fault base, the problem it happened in, and what the step binds."""

    model: FaultModel
    session: Session
    binding: Binding
    problem: Problem | None = None
    left: Plan | None = None  # of the plan that failed, the steps that were not done

    def says(self, name: str) -> str:
        """What people call a test or a repair."""
        found = self.model.tests.get(name) or self.model.repairs.get(name)
        return found.say if found else ""

    def certainties(self, made: Diagnosis) -> dict[Atom, float]:
        """How certain the assertions are that some cause puts in doubt."""
        return certainties(self.model, made.hypotheses, self.binding)

    def revision(self, made: Diagnosis) -> Revision:
        """What the case changes in the world model."""
        repaired = made.cured if made.cured in self.model.repairs else None
        return revision(self.model, made, self.binding, repaired)

    def recover(self, change: Revision, store: str = "") -> Recovery:
        """Plan on; a kept sequence of the problem is told what was lost. Raises `InvalidInput` without a problem."""
        if self.problem is None:
            hint = "give a problem as the target: its goals are planned for"
            raise InvalidInput([Diagnostic(Source("--recover"), "K404", "a domain has no goals", hint)])
        limits = Limits(interrupted=self.session.interrupted)
        found = recover(self.problem, change, limits, self.left)
        return told(found, self.problem, change.lost, store) if store else found

    def keep(self, made: Diagnosis, store: str) -> None:
        """Learn from a case whose cause is known."""
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
    expansions: int | None = None,
    interrupted: Interrupted = never,
    failed: Failed | None = None,
) -> Desk:
    """Open a case. With a problem as target, set-up is planned in it; a domain alone has none. Raises `InvalidInput`.

    With the plan that failed, set-up and recovery begin where it was interrupted.
    """
    loaded = load(find(target))
    problem, left = left_of(loaded, failed) if failed else (loaded.problem, None)
    model, _ = load_faults(Path(loaded.domain.path))
    if exception not in model.exceptions:
        raise InvalidInput([unknown_name("exception", exception, model.exceptions, Source("--exception"))])
    if found := list(too_many(model.exceptions[exception])):
        raise InvalidInput(found)
    binding = binding_of(model, exception, read_step(step, loaded, model.exceptions[exception]))
    limits = replace(WORK, interrupted=interrupted)
    setup = Preparations(problem, binding, limits) if problem else no_setup
    counted = model.exceptions[exception].counts
    if store:
        with Cases(store) as cases:
            counted = counts(counted, cases.history(model.domain, exception))
    session = Session(model, exception, Objective(objective), counted, setup, expansions, interrupted)
    return Desk(model, session, binding, problem, left)


def fault_model(target: str) -> FaultModel:
    """The fault base of a target. Raises `InvalidInput`."""
    return load_faults(Path(load(find(target)).domain.path))[0]
