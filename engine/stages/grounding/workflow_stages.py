"""Workflow chains in a ground task: counters of stages, event batches, and stages in their turn.

An event happens only as the next stage of some chain. A fluent stage is reached where the fluent
holds: an internal operator without cost moves the counter then. To reach it as soon as possible is
never worse, and plans do (`cellwright.engine.model.workflow_replay`), so that it is no choice of
the operators that add the fluent.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.workflow_replay import stage_atom, stage_operator
from cellwright.engine.stages.grounding.atom_deduction import Deduction
from cellwright.engine.stages.grounding.derived_atoms import Rules
from cellwright.engine.stages.grounding.ground_goals import CountedChain
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.planning_problem import (
    Chain,
    Holds,
    Problem,
    final_stages,
    initial_progress,
    late_stages,
    reaches_stage,
)
from cellwright.kb.terms import Atom, Function, Number, is_ground, stage_parts


def matching_atoms(stage: Atom, universe: Universe) -> list[int]:
    """The atoms that reach a fluent stage; `_` in the stage matches everything."""
    if is_ground(stage):
        return [universe.index[stage]] if stage in universe.index else []
    return [number for atom, number in universe.index.items() if reaches_stage(atom, stage)]


@dataclass(frozen=True, slots=True)
class Advance:
    """The conditions and effects that an operator gets in addition when it reaches certain
    stages.
    """

    conditions: Bits = 0
    adds: Bits = 0
    deletes: Bits = 0

    def __or__(self, other: "Advance") -> "Advance":
        return Advance(
            self.conditions | other.conditions, self.adds | other.adds, self.deletes | other.deletes
        )


@dataclass(frozen=True, slots=True)
class NumberedChain:
    """A chain, the bit of each count of its stages, and the last bits of the chains that it
    waits for.
    """

    chain: Chain
    counters: tuple[Bits, ...]
    waits: Bits


class Workflow:
    """The chains of a problem over numbered atoms.

    The counters have numbers from `first` on, after the atoms of the universe.
    """

    def __init__(
        self, problem: Problem, universe: Universe, first: int, events: set[str], start: Holds
    ) -> None:
        self.events = events
        self.atoms: list[Atom] = []
        self.initial = self.goal = 0
        self.groups: list[Bits] = []
        self.courses: list[NumberedChain] = []
        self.reaching: list[GroundOperator] = []
        self._event_stages: dict[Atom, list[Advance]] = {}
        self._finished: dict[str, Bits] = {}
        self._lasting = final_stages(problem.chains, problem.domain)
        self._domain, self.begun = problem.domain, initial_progress(problem.chains, start)
        for chain in problem.chains:
            self._add(chain, self.begun[chain.name], universe, first)

    def _add(self, chain: Chain, count: int, universe: Universe, first: int) -> None:
        start = first + len(self.atoms)
        self.atoms.extend(stage_atom(chain, reached) for reached in range(len(chain.stages) + 1))
        counters = tuple(1 << (start + reached) for reached in range(len(chain.stages) + 1))
        self.initial |= counters[count]
        self.goal |= counters[-1] if chain.wanted else 0
        self.groups.append(sum(counters))
        self._finished[chain.name] = counters[-1]
        waits = 0
        for earlier in chain.after:
            waits |= self._finished[earlier]
        self.courses.append(NumberedChain(chain, counters, waits))
        for reached, stage in enumerate(chain.stages):
            needed = counters[reached] | (0 if reached else waits)
            advance = Advance(needed, counters[reached + 1], counters[reached])
            if stage.name in self.events:
                self._event_stages.setdefault(stage, []).append(advance)
            else:
                part_atoms = [matching_atoms(part, universe) for part in stage_parts(stage)]
                self._reach(advance, chain, reached + 1, itertools.product(*part_atoms))
        if chain.name in self._lasting:
            for last in self._lasting[chain.name]:
                self.goal |= bitset(matching_atoms(last, universe))

    def counted(self, universe: Universe) -> Iterator[tuple[str, CountedChain]]:
        """Each chain that waits for no other one, with what has to hold at the end if it is cut
        after so many stages.
        """
        for course in self.courses:
            chain, ends = course.chain, [0]
            for number in range(1, len(chain.stages) + 1):
                cut = replace(chain, stages=chain.stages[:number], after=())
                atoms = (
                    n
                    for last in final_stages([cut], self._domain).values()
                    for stage in last
                    for n in matching_atoms(stage, universe)
                )
                ends.append(bitset(atoms))
            yield chain.name, CountedChain(course.counters, self.begun[chain.name], tuple(ends))

    def _reach(
        self, advance: Advance, chain: Chain, count: int, choices: Iterable[tuple[int, ...]]
    ) -> None:
        """The internal operators that move a chain to a count while all atoms of some choice
        hold.
        """
        name = stage_operator(chain, count)
        for atoms in choices:
            needed = advance.conditions | bitset(atoms)
            self.reaching.append(
                GroundOperator(name, needed, advance.adds, advance.deletes, cost=0)
            )

    def advances(self, events: Sequence[Atom]) -> Iterator[Advance]:
        """The ways in which an operator with these events can move the counters; none if an
        event has no stage.
        """
        choices = [self._event_stages.get(event, []) for event in events]
        for combination in itertools.product(*choices):
            total = Advance()
            for advance in combination:
                total = total | advance
            if total.adds.bit_count() == len(combination) and self._one_each(total):
                yield total

    def stages_of(self, event: Atom) -> Sequence[Advance]:
        """How each stage that an event is, in whatever chain, moves the chain's counter."""
        return self._event_stages.get(event, ())

    def _one_each(self, advance: Advance) -> bool:
        """Whether the operator moves each counter at most once."""
        return all((group & advance.adds).bit_count() <= 1 for group in self.groups)


SignedCondition = tuple[int, ...]
ConditionalChange = tuple[
    SignedCondition, Bits, Bits
]  # the conditions of a conditional effect, what it adds and what it deletes


@dataclass
class StageTurns:
    """Which atoms wait for their turn.

    `rules` gets the derived atoms for those that operators add under conditions.
    """

    domain: Domain
    workflow: Workflow
    universe: Universe
    initial: Bits
    deduction: Deduction
    changes: Mapping[tuple[str, SignedCondition], Sequence[ConditionalChange]]
    rules: Rules
    held: Bits = 0  # the atoms that complete a stage whose turn may be to come
    _stages: dict[int, list[tuple[NumberedChain, int]]] = field(default_factory=dict)
    _late: dict[int, list[Atom]] = field(default_factory=dict)
    _allowed: dict[tuple[int, SignedCondition], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._courses = {course.chain.name: course for course in self.workflow.courses}
        chains = [course.chain for course in self.workflow.courses]
        for stage in late_stages(chains, self.domain):
            for atom in self._atoms_of(stage):
                self._late.setdefault(atom, []).append(stage)
        self.held = bitset(self._late) & ~self.initial
        self.names = {self.universe.atoms[atom].name for atom in indices(self.held)}
        for course in self.workflow.courses if self.held else ():
            for number, stage in enumerate(course.chain.stages):
                for atom in self._atoms_of(stage):
                    self._stages.setdefault(atom, []).append((course, number))
        for operator, arguments in self.changes if self.held else ():
            for atom, conditions in self._conditional(operator, arguments):
                self._allow(atom, conditions)

    def _atoms_of(self, stage: Atom) -> list[int]:
        return list(
            dict.fromkeys(
                n for part in stage_parts(stage) for n in matching_atoms(part, self.universe)
            )
        )

    def concerns(self, operator: Operator) -> bool:
        """Whether instances of an operator may add an atom that waits for its turn."""
        if not self.held:
            return False
        implied = {
            c.atom.name
            for deductive_operator in self.domain.deductive_operators
            for c in deductive_operator.consequences
            if c.implied
        }
        return bool(
            self.names
            & (implied | {effect.atom.name for effect in operator.effects if effect.adds})
        )

    def conditions(self, operator: str, arguments: SignedCondition) -> list[int]:
        """What an instance needs in addition because of what it adds under conditions."""
        if not self.held:
            return []
        return list(
            dict.fromkeys(self._allowed[pair] for pair in self._conditional(operator, arguments))
        )

    def _conditional(
        self, operator: str, arguments: SignedCondition
    ) -> Iterator[tuple[int, SignedCondition]]:
        """The atoms that wait for their turn and that an instance adds under conditions, with
        these.
        """
        for conditions, adds, _ in self.changes.get((operator, arguments), ()):
            before = bitset(
                condition for condition in conditions if 0 <= condition < len(self.universe.atoms)
            )
            added, _ = self.deduction.close(adds, before)
            yield from ((atom, conditions) for atom in indices(added & self.held))

    def _allow(self, atom: int, conditions: SignedCondition) -> None:
        if (atom, conditions) in self._allowed:
            return
        name = Function("_turn", (self.universe.atoms[atom], Number(len(self._allowed))))
        number = self._allowed[atom, conditions] = self.universe.derive(name)
        self.rules[number] = [
            *((~condition,) for condition in conditions),
            *self._ways(atom, 1 << atom, Advance()),
        ]

    def ways(self, adds: Bits, advance: Advance) -> list[SignedCondition]:
        """The conditions, as signed atoms, of which one must hold so that an operator may add
        some atoms.
        """
        choices = [self._ways(atom, adds, advance) for atom in indices(adds & self.held)]
        return [
            tuple(dict.fromkeys(itertools.chain(*choice))) for choice in itertools.product(*choices)
        ]

    def _ways(self, atom: int, adds: Bits, advance: Advance) -> list[SignedCondition]:
        """Those for one atom: it serves a stage that a chain waits for, or completes none."""
        serving_ways = [
            conditions
            for place in self._stages.get(atom, ())
            for conditions in self._in_turn(*place, adds, advance)
        ]
        apart = itertools.product(*(self._apart(stage, atom) for stage in self._late[atom]))
        return list(
            dict.fromkeys(
                [*serving_ways, *(tuple(itertools.chain(*combination)) for combination in apart)]
            )
        )

    def _in_turn(
        self, course: NumberedChain, stage: int, adds: Bits, advance: Advance
    ) -> Iterator[SignedCondition]:
        """When a chain waits for a stage as a step ends, which may reach the stages before this
        one as well.
        """
        own = self._come_to(course, stage, adds, advance)
        if stage or not course.waits:
            yield from own
            return
        awaited = [self._courses[name] for name in course.chain.after]
        ends = (
            self._come_to(awaited_course, len(awaited_course.chain.stages), adds, advance)
            for awaited_course in awaited
        )
        yield from (
            tuple(itertools.chain(*combination)) for combination in itertools.product(own, *ends)
        )

    def _come_to(
        self, course: NumberedChain, count: int, adds: Bits, advance: Advance
    ) -> Iterator[SignedCondition]:
        """When a chain has reached so many stages as a step ends."""
        if advance.adds & course.counters[count]:
            yield ()
            return
        yield tuple(indices(course.counters[count]))
        if count and self._reaches(course.chain.stages[count - 1], adds):
            yield from self._in_turn(course, count - 1, adds, advance)

    def _reaches(self, stage: Atom, adds: Bits) -> bool:
        return all(
            bitset(matching_atoms(part, self.universe)) & adds for part in stage_parts(stage)
        )

    def _apart(self, stage: Atom, atom: int) -> Iterator[SignedCondition]:
        """The ways in which an atom does not complete a stage."""
        own = [
            part for part in stage_parts(stage) if reaches_stage(self.universe.atoms[atom], part)
        ]
        for part in stage_parts(stage):
            if part not in own:
                yield tuple(~part_atom for part_atom in matching_atoms(part, self.universe))
        yield from itertools.product(*(matching_atoms(part, self.universe) for part in own))


Signed = tuple[int, ...]
Happening = tuple[Signed, Atom]


@dataclass
class EventBatches:
    """The events of each operator instance that happen under conditions.

    `rules` gets those of their derived atoms.
    """

    workflow: Workflow
    happening: Mapping[tuple[str, Signed], Sequence[Happening]]
    universe: Universe
    rules: Rules
    _allowed: dict[tuple[Atom, Signed], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for conditional_events in self.happening.values():
            for conditions, event in conditional_events:
                self._allow(event, conditions)

    def conditions(self, operator: str, arguments: Signed) -> list[int]:
        """What an instance needs in addition, so that no event occurs that no chain waits for."""
        conditional_events = self.happening.get((operator, arguments), ())
        return list(
            dict.fromkeys(
                self._allowed[event, conditions] for conditions, event in conditional_events
            )
        )

    def advances(self, operator: str, arguments: Signed) -> list[tuple[Signed, Advance]]:
        """How an instance moves which counter under which conditions.

        Of several chains that wait, the first one moves.
        """
        return [
            ((*conditions, *waiting), advance)
            for conditions, event in self.happening.get((operator, arguments), ())
            for waiting, advance in self._moves(event)
        ]

    def _moves(self, event: Atom) -> Iterator[tuple[Signed, Advance]]:
        """Each stage that an event is: what makes its chain the first one that waits, and how
        its counter moves.
        """
        earlier: list[Advance] = []
        stages = self.workflow.stages_of(event)
        for group in self.workflow.groups:
            own = [stage for stage in stages if stage.adds & group]
            other_conditions = [
                [~atom for atom in indices(earlier_stage.conditions)] for earlier_stage in earlier
            ]
            for own_stage in own:
                for broken in itertools.product(*other_conditions):
                    yield (*indices(own_stage.conditions), *dict.fromkeys(broken)), own_stage
            earlier += own

    def _allow(self, event: Atom, conditions: Signed) -> None:
        if (event, conditions) in self._allowed:
            return
        number = self._allowed[event, conditions] = self.universe.derive(Function("_may", (event,)))
        stages = self.workflow.stages_of(event)
        bodies = [
            *((~condition,) for condition in conditions),
            *(tuple(indices(stage.conditions)) for stage in stages),
        ]
        self.rules[number] = bodies
