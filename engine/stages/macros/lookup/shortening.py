"""Drops loops and needless steps from instances of MACROPs.

A MACROP was learned where every step was needed. Elsewhere its instance may go round in a circle,
or do what is done already. Each step is dropped on trial, with all steps that cannot run without it
(action elimination; Nakhost & Müller 2010). A loop is dropped in this way too: without its first
step, none of its steps can run, and the plan goes on where the loop began.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.engine.stages.lifted.ground_steps import GroundStep
from cellwright.engine.stages.macros.lookup.macro_instances import check_instance
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.plan_model import (
    GOAL_STEP,
    INITIAL_STEP,
    CausalLink,
    Plan,
    StepId,
    full_order,
)
from cellwright.kb.terms import Atom, is_ground, match_term

Needs = tuple[int, int]  # the atoms that must hold, and those that must not, as bits


@dataclass(frozen=True, slots=True)
class _BitStep:
    """A step over numbered atoms. One that `stays` reaches a stage of a chain."""

    needs: tuple[Needs, ...]
    adds: int
    ends: int
    stays: bool

    def after(self, state: int) -> int | None:
        """The state after the step; None if it cannot be taken."""
        if not any(holding & ~state == 0 and absent & state == 0 for holding, absent in self.needs):
            return None
        return state & ~self.ends | self.adds


def shortened(plan: Plan, after: Situation, asked: MacroQuery) -> tuple[Plan, Situation]:
    """A checked plan, and the situation `after` it, without the steps that the query does not need;
    the same if all are needed.
    """
    known = [asked.world.ground_step(step.operator) for step in plan.steps]
    ground = [step for step in known if step is not None]
    if len(ground) < len(known):
        return plan, after
    kept = _needed(ground, after, asked)
    if len(kept) == len(plan.steps):
        return plan, after
    shorter = _with_steps(plan, kept, ground)
    for candidate in (shorter, full_order(shorter)):
        end = check_instance(candidate, asked)
        if isinstance(end, Situation):
            return candidate, end
    return plan, after


def _needed(ground: Sequence[GroundStep], after: Situation, asked: MacroQuery) -> Sequence[int]:
    """The places of the steps that are left when each was dropped on trial."""
    places = list(range(len(ground)))
    goals = _witnesses(asked, after)
    if goals is None:
        return places
    numbers = _Numbering(asked.facts)
    wanted = numbers.bits(goals[0]), numbers.bits(goals[1])
    for step in ground:
        numbers.note(step)
    staged = {stage.name for chain in asked.chains for stage in chain.stages}
    every = FactSet(numbers.atoms)
    steps = [numbers.step(step, every, asked.world.statics, staged) for step in ground]
    place = 0
    while place < len(places):
        fewer = _without(steps, places, place, numbers.initial, wanted)
        if fewer is None:
            place += 1
        else:
            places = fewer
    return places


def _without(
    steps: Sequence[_BitStep], places: Sequence[int], dropped: int, state: int, wanted: Needs
) -> list[int] | None:
    """The places without one of them and without those that cannot run then; None if a goal is
    lost.
    """
    left: list[int] = []
    for position, place in enumerate(places):
        after = steps[place].after(state) if position != dropped else None
        if after is not None:
            left.append(place)
            state = after
        elif steps[place].stays:
            return None
    return left if wanted[0] & ~state == 0 and wanted[1] & state == 0 else None


def _witnesses(asked: MacroQuery, after: Situation) -> tuple[list[Atom], list[Atom]] | None:
    """Atoms that hold, and atoms that do not, at the end of a plan, so that all goals are met; None
    if fluents do not tell.
    """
    present, absent = list[Atom](), list[Atom]()
    for goal in (*asked.goals, *asked.kept):
        if not asked.world.schemas.is_dynamic(goal):
            continue
        if asked.world.schemas.is_derived(goal.atom):
            return None
        atom = goal.atom if is_ground(goal.atom) else _instance(goal, after)
        if atom is None:
            return None
        (present if goal.positive else absent).append(atom)
    return present, absent


def _instance(goal: Literal, after: Situation) -> Atom | None:
    """An atom of a situation that meets a goal with `_`."""
    if not goal.positive:
        return None
    fitting = (
        atom
        for atom in after.facts.matching(goal.atom)
        if match_term(goal.atom, atom, {}) is not None
    )
    return next(fitting, None)


@dataclass
class _Numbering:
    """The atoms that a plan touches, by number, and which of them hold at the start."""

    facts: FactSet
    numbers: dict[Atom, int] = field(default_factory=dict)
    initial: int = 0

    @property
    def atoms(self) -> Iterable[Atom]:
        """The atoms in the order of their numbers."""
        return self.numbers

    def bits(self, atoms: Iterable[Atom]) -> int:
        """A set of atoms as bits. New ones get a number."""
        found = 0
        for atom in atoms:
            number = self.numbers.setdefault(atom, len(self.numbers))
            found |= 1 << number
            if atom in self.facts:
                self.initial |= 1 << number
        return found

    def note(self, step: GroundStep) -> None:
        """Number the atoms of a step."""
        for holding, absent in step.alternatives:
            self.bits((*holding, *absent))
        self.bits((*step.adds, *step.ends))

    def step(
        self, step: GroundStep, every: FactSet, statics: FactSet, staged: set[str]
    ) -> _BitStep:
        """A step over numbered atoms; `every` are all of these."""
        needs = tuple(
            (self.bits(holding), self.bits(absent)) for holding, absent in step.alternatives
        )
        adds = self.bits(step.adds)
        ends = self.bits(step.ended(every, statics)) & ~adds
        stays = bool(step.events) or any(atom.name in staged for atom in step.adds)
        return _BitStep(needs, adds, ends, stays)


def _with_steps(plan: Plan, places: Sequence[int], known: Sequence[GroundStep]) -> Plan:
    """The plan of the steps at some places, numbered from 1, in the orders that the whole plan has
    for them.

    What a step that is left out achieved is there already: by a step before it, or from the start.
    """
    before = plan.predecessors()
    kept = [plan.steps[place] for place in places]
    numbers = {step.id: StepId(number) for number, step in enumerate(kept, 1)}
    earlier = {
        numbers[s.id]: {numbers[each] for each in before[s.id] if each in numbers} for s in kept
    }
    links: list[CausalLink] = []
    for link in plan.links:
        if link.consumer not in (GOAL_STEP, *numbers):
            continue
        consumer = numbers.get(link.consumer, GOAL_STEP)
        producer = numbers.get(link.producer, INITIAL_STEP)
        if producer == INITIAL_STEP != link.producer:
            until = len(kept) if consumer == GOAL_STEP else consumer - 1
            producer = _last_achiever(link.condition, [known[place] for place in places[:until]])
        if producer != INITIAL_STEP and consumer != GOAL_STEP:
            earlier[consumer] |= {producer, *earlier[producer]}
        links.append(CausalLink(producer, link.condition, consumer))
    steps = tuple(
        replace(step, id=numbers[step.id], after=_direct(earlier[numbers[step.id]], earlier))
        for step in kept
    )
    return Plan(steps, tuple(dict.fromkeys(links)))


def _last_achiever(condition: Atom, steps: Sequence[GroundStep]) -> StepId:
    """The last of the steps that makes a condition true, numbered from 1; the start if none
    does.
    """
    inner = (
        condition.arguments[0]
        if condition.name == "not" and len(condition.arguments) == 1
        else None
    )
    for number in range(len(steps), 0, -1):
        step = steps[number - 1]
        if condition in step.adds or (inner is not None and inner in step.ends):
            return StepId(number)
    return INITIAL_STEP


def _direct(earlier: set[StepId], known: dict[StepId, set[StepId]]) -> tuple[StepId, ...]:
    """The steps that come before a step, without those that come before another one of them."""
    return tuple(sorted(earlier - {each for between in earlier for each in known[between]}))
