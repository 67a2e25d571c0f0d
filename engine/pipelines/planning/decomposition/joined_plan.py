"""Joins the steps of all parts to one plan with causal links; replans one part of such a plan."""

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.part_measurements import names_in_goal
from cellwright.engine.pipelines.planning.decomposition.measurement_order import Itinerary
from cellwright.engine.pipelines.planning.decomposition.part_chain import (
    Notebook,
    PartChain,
    PlanningPart,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation, StepChange
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.engine.stages.lifted.ground_steps import Needed
from cellwright.engine.stages.lifted.lifted_execution import changes_of, find_support
from cellwright.engine.stages.macros.lookup.macro_query import goal_literal
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, match_term


@dataclass(frozen=True, slots=True)
class AtOnce:
    """How steps of several arms are ordered: measurements that wait for others (second: first
    ones), by the atom that makes them.
    """

    measured: str
    waits: Mapping[str, tuple[str, ...]]
    names: Collection[str]


def of_arms(problem: Problem, route: Itinerary) -> AtOnce | None:
    """How the steps along an itinerary are ordered; None if one arm takes them one after
    another.
    """
    if route.shared is None:
        return None
    waits = dict[str, tuple[str, ...]]()
    for first, second in route.shared.waits:
        waits[second] = (*waits.get(second, ()), first)
    return AtOnce(problem.domain.conventions.measured, waits, {name for name, _ in route.visits})


def join_parts(
    start: Situation, steps: Sequence[Step], goals: Iterable[Literal], at_once: AtOnce | None = None
) -> Plan:
    """The plan of the steps, with a link for each condition of a step that names its atoms.

    One comes after another; `at_once`, only those wait for others that need them, disturb them, or
    hold the same resources.
    """
    world, facts = start.world, start.facts
    joined_steps: list[Step] = []
    links: list[CausalLink] = []
    last: dict[Atom, StepId] = {}
    needs = _StepNeeds(at_once) if at_once else None
    for number, step in enumerate(steps, 1):
        own = StepId(number)
        ground_step = world.ground_step(step.operator)
        if ground_step is None:
            needed = list(_derived_supports(world, step.operator, facts))
            change = world.change(step.operator, facts)
            adds, ends = change.adds, change.ends
        else:
            needed = list(_first_conditions(ground_step.alternatives, facts))
            adds, ends = ground_step.adds, ground_step.ended(facts, world.statics)
        after: tuple[StepId, ...] = (StepId(number - 1),) if joined_steps else ()
        after = needs.after(own, step, needed, (*adds, *ends)) if needs else after
        joined_steps.append(replace(step, id=own, after=after))
        links += [
            CausalLink(last.get(condition, INITIAL_STEP), condition, own) for condition in needed
        ]
        last.update((atom, own) for atom in adds)
        last.update((Function("not", (atom,)), own) for atom in ends)
        facts = facts.after(ends, adds)
    reached = (atom for goal in goals for atom in _reaching_atom(goal, facts))
    links += [CausalLink(last.get(atom, INITIAL_STEP), atom, GOAL_STEP) for atom in reached]
    return Plan(tuple(joined_steps), tuple(links))


@dataclass
class _StepNeeds:
    """Which earlier steps each step waits for: two steps may go on at once if neither changes
    what the other reads or changes.
    """

    at_once: AtOnce
    changed: dict[Atom, int] = field(default_factory=dict)
    read: dict[Atom, list[int]] = field(default_factory=dict)
    held: dict[Term, int] = field(default_factory=dict)
    makes: dict[str, int] = field(default_factory=dict)
    behind: list[int] = field(default_factory=lambda: [0])  # the steps before each one, as bits

    def after(
        self, own: StepId, step: Step, needed: Sequence[Atom], changes: Sequence[Atom]
    ) -> tuple[StepId, ...]:
        """The steps that a step waits for, without those that others of them wait for."""
        reads, number = [_positive_atom(condition) for condition in needed], int(own)
        waits = {self.changed[atom] for atom in (*reads, *changes) if atom in self.changed}
        waits |= {reader for atom in changes for reader in self.read.get(atom, ())}
        waits |= {self.held[resource] for resource in step.resources if resource in self.held}
        waits |= self._measured(number, changes)
        for atom in reads:
            self.read.setdefault(atom, []).append(number)
        for atom in changes:
            self.changed[atom], self.read[atom] = number, []
        self.held.update(dict.fromkeys(step.resources, number))
        implied = 0
        for earlier in waits:
            implied |= self.behind[earlier]
        self.behind.append(implied | sum(1 << earlier for earlier in waits))
        return tuple(StepId(earlier) for earlier in sorted(waits) if not implied >> earlier & 1)

    def _measured(self, number: int, changes: Sequence[Atom]) -> set[int]:
        """The steps that make the measurements for which those of this step wait."""
        waited = set[int]()
        for atom in changes:
            if atom.name != self.at_once.measured:
                continue
            for name in names_in_goal(Literal(atom), self.at_once.names):
                self.makes[name] = number
                waited |= {
                    self.makes[first_name]
                    for first_name in self.at_once.waits.get(name, ())
                    if first_name in self.makes
                }
        return waited - {number}


def _positive_atom(atom: Atom) -> Atom:
    """The atom of a condition that it is false; else the atom itself."""
    if atom.name == "not" and len(atom.arguments) == 1 and isinstance(atom.arguments[0], Function):
        return atom.arguments[0]
    return atom


def _first_conditions(alternatives: Sequence[Needed], facts: FactSet) -> Iterator[Atom]:
    """The conditions of the first alternative that holds."""
    for holding, absent in alternatives:
        if all(atom in facts for atom in holding) and not any(atom in facts for atom in absent):
            yield from holding
            yield from (Function("not", (atom,)) for atom in absent)
            return


def _derived_supports(world: CellDomain, step: Function, facts: FactSet) -> Iterator[Atom]:
    """What the first alternative of a step's condition that holds rests on, through the rules
    of derived predicates.
    """
    schema, bindings = world.binding(step)
    supports = (find_support(body, world, facts, bindings) for body in schema.alternatives)
    yield from dict.fromkeys(
        next((atoms_of_body for atoms_of_body in supports if atoms_of_body is not None), ())
    )


def _reaching_atom(goal: Literal, facts: FactSet) -> Iterator[Atom]:
    """The first atom that a goal asks for, if it asks for one."""
    if goal.positive:
        matching = (
            atom
            for atom in facts.matching(goal.atom)
            if match_term(goal.atom, atom, {}) is not None
        )
        yield from itertools.islice(matching, 1)


@dataclass(frozen=True)
class _OldPlan:
    """The plan as it was: its steps, what each has changed, and after which step each
    measurement is made.
    """

    steps: Sequence[Step]
    changes: Sequence[StepChange]
    ends: Mapping[str, int]

    def went_on(self, state: set[Atom], first: int, last: int) -> None:
        """Change a state as the steps from the first to before the last have done."""
        for change in self.changes[first:last]:
            state.difference_update(change.ends)
            state.update(change.adds)


def patch_plan(
    problem: Problem,
    plan: Plan,
    route: Itinerary,
    failed: StepId,
    limits: SearchLimits = SearchLimits(),
) -> Outcome | None:
    """The plan with the part of the failed step planned anew, and the parts behind it until all is
    as it was.

    `problem` is that of the plan, with fewer goals or stricter operators. The answer is infeasible
    if the part has no plan of its own; None if another plan must be found.
    """
    steps, operator_names = plan.steps, {operator.name for operator in problem.domain.operators}
    if any(step.operator.name not in operator_names for step in steps):
        return None
    state, contradicted = initial_state(problem, ChangingPredicates(problem.domain))
    if contradicted:
        return None
    start = Situation.of(CellDomain(problem), state)
    changes = changes_of(start, steps)
    old = _OldPlan(
        steps, changes, _measuring_ends(problem, changes, {name for name, _ in route.visits})
    )
    at = next(n for n, step in enumerate(steps) if step.id == failed)
    outcome = _gone_on(problem, route, old, at, start, limits)
    return _patched_plan(problem, start, outcome, route) if isinstance(outcome, list) else outcome


def _measuring_ends(
    problem: Problem, changes: Sequence[StepChange], names: set[str]
) -> dict[str, int]:
    measured, ends = problem.domain.conventions.measured, dict[str, int]()
    for n, change in enumerate(changes):
        for atom in change.adds:
            if atom.name == measured:
                for name in names_in_goal(Literal(atom), names):
                    ends.setdefault(name, n)
    return ends


def _gone_on(
    problem: Problem,
    route: Itinerary,
    old: _OldPlan,
    at: int,
    start: Situation,
    limits: SearchLimits,
) -> list[Step] | Infeasible | None:
    """The steps up to the part of the failed one, the parts from there on until the state is
    the old one, and the rest as it was.
    """
    begins = max((end + 1 for end in old.ends.values() if end < at), default=0)
    was = set(start.state)
    old.went_on(was, 0, begins)
    line = PartChain(
        problem, Situation.of(start.world, was), Notebook(), limits, list(old.steps[:begins])
    )
    every = route.parts(problem)
    parts = [part for part in every if old.ends.get(part.name, len(old.steps)) >= begins]
    lost, gone = set(old.ends) - {part.name for part in every}, begins
    for part in parts:
        failed = line.run([part])
        if failed is not None:
            return _find_hopeless(line, part, start)
        end = old.ends.get(part.name)
        if end is None or end < at:
            continue
        old.went_on(was, gone, end + 1)
        gone = end + 1
        if _differs_by_lost(line.here.state, was, lost):
            return [*line.steps, *old.steps[gone:]]
    return line.steps


def _find_hopeless(line: PartChain, part: PlanningPart, start: Situation) -> Infeasible | None:
    alone = line.alone(part, start)
    if not isinstance(alone, Infeasible):
        return None
    about = f"{part.name}: " if part.name else ""
    return Infeasible(f"{about}{alone.reason}", alone.statistics)


def _differs_by_lost(first: frozenset[Atom], second: set[Atom], lost: set[str]) -> bool:
    """Whether two states differ in nothing but what is about lost measurements."""
    return all(names_in_goal(Literal(atom), lost) for atom in first ^ second)


def _patched_plan(
    problem: Problem, start: Situation, steps: Sequence[Step], route: Itinerary
) -> Found | None:
    goals = (goal_literal(goal) for goal in goal_parts(problem.goal))
    plan = join_parts(
        start, steps, [goal for goal in goals if goal is not None], of_arms(problem, route)
    )
    plan, wrong = PlanGate().settled(problem, plan)
    return None if wrong else Found(plan)
