"""The steps of all parts as one plan, with the causal links between them; steps of several arms go on at once where they can."""

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.measurements import named
from cellwright.engine.pipelines.parts.itinerary import Itinerary
from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.ground_steps import Needed
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.support import support
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, match


@dataclass(frozen=True, slots=True)
class AtOnce:
    """How steps of several arms are ordered: measurements that wait for others (second: first ones), by the atom that makes them."""

    measured: str
    waits: Mapping[str, tuple[str, ...]]
    names: Collection[str]


def of_arms(problem: Problem, way: Itinerary) -> AtOnce | None:
    """How the steps along an itinerary are ordered; None if one arm takes them one after another."""
    if way.shared is None:
        return None
    waits = dict[str, tuple[str, ...]]()
    for first, second in way.shared.waits:
        waits[second] = (*waits.get(second, ()), first)
    return AtOnce(problem.domain.conventions.measured, waits, {name for name, _ in way.visits})


def joined(
    start: Situation, steps: Sequence[Step], goals: Iterable[Literal], at_once: AtOnce | None = None
) -> Plan:
    """The plan of the steps, with a link for each condition of a step that names its atoms.

    One comes after another; `at_once`, only those wait for others that need them, disturb them, or hold the same resources.
    """
    world, facts = start.world, start.facts
    made: list[Step] = []
    links: list[CausalLink] = []
    last: dict[Atom, StepId] = {}
    needs = _Needs(at_once) if at_once else None
    for number, step in enumerate(steps, 1):
        own = StepId(number)
        known = world.ground_step(step.operator)
        if known is None:
            needed = list(_supports(world, step.operator, facts))
            change = world.change(step.operator, facts)
            adds, ends = change.adds, change.ends
        else:
            needed = list(_conditions(known.alternatives, facts))
            adds, ends = known.adds, known.ended(facts, world.statics)
        after: tuple[StepId, ...] = (StepId(number - 1),) if made else ()
        after = needs.after(own, step, needed, (*adds, *ends)) if needs else after
        made.append(replace(step, id=own, after=after))
        links += [CausalLink(last.get(each, START), each, own) for each in needed]
        last.update((atom, own) for atom in adds)
        last.update((Function("not", (atom,)), own) for atom in ends)
        facts = facts.after(ends, adds)
    reached = (atom for goal in goals for atom in _reaching(goal, facts))
    links += [CausalLink(last.get(atom, START), atom, GOAL) for atom in reached]
    return Plan(tuple(made), tuple(links))


@dataclass
class _Needs:
    """Which earlier steps each step waits for: two steps may go on at once if neither changes what the other reads or changes."""

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
        reads, number = [_plain(each) for each in needed], int(own)
        waits = {self.changed[atom] for atom in (*reads, *changes) if atom in self.changed}
        waits |= {each for atom in changes for each in self.read.get(atom, ())}
        waits |= {self.held[each] for each in step.resources if each in self.held}
        waits |= self._measured(number, changes)
        for atom in reads:
            self.read.setdefault(atom, []).append(number)
        for atom in changes:
            self.changed[atom], self.read[atom] = number, []
        self.held.update(dict.fromkeys(step.resources, number))
        implied = 0
        for each in waits:
            implied |= self.behind[each]
        self.behind.append(implied | sum(1 << each for each in waits))
        return tuple(StepId(each) for each in sorted(waits) if not implied >> each & 1)

    def _measured(self, number: int, changes: Sequence[Atom]) -> set[int]:
        """The steps that make the measurements for which those of this step wait."""
        found = set[int]()
        for atom in changes:
            if atom.name != self.at_once.measured:
                continue
            for name in named(Literal(atom), self.at_once.names):
                self.makes[name] = number
                found |= {self.makes[each] for each in self.at_once.waits.get(name, ()) if each in self.makes}
        return found - {number}


def _plain(atom: Atom) -> Atom:
    """The atom of a condition that it is false; else the atom itself."""
    if atom.name == "not" and len(atom.arguments) == 1 and isinstance(atom.arguments[0], Function):
        return atom.arguments[0]
    return atom


def _conditions(alternatives: Sequence[Needed], facts: Facts) -> Iterator[Atom]:
    """The conditions of the first alternative that holds."""
    for holding, absent in alternatives:
        if all(atom in facts for atom in holding) and not any(atom in facts for atom in absent):
            yield from holding
            yield from (Function("not", (atom,)) for atom in absent)
            return


def _supports(world: CellDomain, step: Function, facts: Facts) -> Iterator[Atom]:
    """What the first alternative of a step's condition that holds rests on, through the rules of derived predicates."""
    schema, bindings = world.binding(step)
    found = (support(body, world, facts, bindings) for body in schema.alternatives)
    yield from dict.fromkeys(next((each for each in found if each is not None), ()))


def _reaching(goal: Literal, facts: Facts) -> Iterator[Atom]:
    """The first atom that a goal asks for, if it asks for one."""
    if goal.positive:
        found = (atom for atom in facts.matching(goal.atom) if match(goal.atom, atom, {}) is not None)
        yield from itertools.islice(found, 1)
