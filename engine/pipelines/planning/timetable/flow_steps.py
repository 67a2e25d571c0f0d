"""Turns the schedule of a flow into a plan: the steps of each act, with the names of its object and
of its places.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.flow import FOREVER, Course, Held, holds_of_course
from cellwright.engine.pipelines.planning.timetable.flows import CellFlow, Kind
from cellwright.engine.stages.scheduling.flow.graph import Stride
from cellwright.engine.stages.scheduling.shop_translation import Mislaid
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Atom, Function, Number, Term, Text

Names = Mapping[Term, Term]


@dataclass(frozen=True, slots=True)
class FlowStep:
    """A step of an item and when it starts; `reads` and `draws` are quantities that it looks
    at, and what it adds to them.
    """

    instance: Function
    start: int
    duration: int
    cost: int
    resources: tuple[Term, ...]
    needs: tuple[Atom, ...]
    adds: tuple[Atom, ...]
    ends: tuple[Atom, ...]
    reads: tuple[Function, ...]
    draws: tuple[tuple[Function, int], ...]
    item: int

    @property
    def end(self) -> int:
        """When the step ends."""
        return self.start + self.duration


def steps_of(cell: CellFlow, courses: Sequence[Course]) -> list[FlowStep]:
    """The steps of all courses in the order of their starts.

    Raises `Mislaid` if some place is missing.
    """
    units = _units(cell, courses)
    writer = _Writer(cell)
    steps = [
        step
        for item, course in enumerate(courses)
        for step in writer.steps(item, course, units.get(item, ()))
    ]
    number = {id(step): n for n, step in enumerate(steps)}
    return sorted(steps, key=lambda each: (each.start, each.end, number[id(each)]))


# what is held, the place that its route names, and the place that it got
Visit = tuple[Held, Term, Term]


def _units(cell: CellFlow, courses: Sequence[Course]) -> dict[int, list[Visit]]:
    """For each item its visits of places of which there are several equal ones: first come,
    first served.
    """
    visits: dict[str, list[tuple[int, int, int, Held]]] = {}
    for item, course in enumerate(courses):
        for hold in holds_of_course(course.acts, cell.flow.route(item).held):
            if hold.place in cell.pools:
                begin = 0 if hold.first is None else course.starts[hold.first] + hold.begin
                end = FOREVER if hold.last is None else course.starts[hold.last] + hold.end
                visits.setdefault(hold.place, []).append((begin, end, item, hold))
    found: dict[int, list[Visit]] = {}
    for place, own in visits.items():
        units = cell.pools[place]
        until = dict.fromkeys(units, 0)
        for begin, end, item, hold in sorted(own, key=lambda each: each[:3]):
            free = [unit for unit in units if until[unit] <= begin]
            if not free:
                raise Mislaid(f"no place of {place} is free at {begin}")
            until[free[0]] = end
            found.setdefault(item, []).append((hold, units[0], free[0]))
    return found


def unit_names(cell: CellFlow, courses: Sequence[Course]) -> dict[tuple[int, Held], str]:
    """The place that each item got for what it holds, where there are several."""
    return {
        (item, hold): str(place)
        for item, visits in _units(cell, courses).items()
        for hold, _, place in visits
    }


@dataclass
class _Writer:
    cell: CellFlow
    atoms: dict[tuple[int, Bits], tuple[Atom, ...]] = field(default_factory=dict)

    @cached_property
    def chains(self) -> Mapping[Term, list[str]]:
        """The names of the chains of each object."""
        found: dict[Term, list[str]] = {}
        for chain in self.cell.problem.chains:
            if chain.subject is not None:
                found.setdefault(chain.subject, []).append(chain.name)
        return found

    def steps(self, item: int, course: Course, visits: Sequence[Visit]) -> Iterator[FlowStep]:
        number = self.cell.flow.items[item].route
        kind, subject = self.cell.kinds[number], self.cell.subjects[item]
        own: dict[Term, Term] = dict(kind.members[subject])
        own.update(
            (Text(one), Text(other))
            for one, other in zip(kind.chains, self.chains[subject], strict=True)
        )
        for place, (act, start) in enumerate(zip(course.acts, course.starts, strict=True)):
            names = own | _name_places(visits, place)
            for stride, begin, _ in self.cell.edges[number][place][act.number].timed:
                yield self._step(kind, number, stride, start + begin, item, names)

    def _step(
        self, kind: Kind, number: int, stride: Stride, start: int, item: int, names: Names
    ) -> FlowStep:
        operator = stride.operator

        def renamed(bits: Bits) -> tuple[Atom, ...]:
            known = self.atoms.get((number, bits))
            if known is None:
                known = self.atoms[number, bits] = kind.task.names(bits)
            return tuple(_atom(each, names) for each in known)

        tests = [kind.maker.graph.test_of(n)[0] for n in indices(stride.compared)]
        read = dict.fromkeys(level.quantity for test in tests for level, _ in test.sum.parts)
        read |= dict.fromkeys(change.level.quantity for change in operator.changes)
        draws = tuple(
            (_atom(change.level.quantity, names), change.to.without(change.level).constant)
            for change in operator.changes
        )
        return FlowStep(
            _atom(operator.instance, names),
            start,
            operator.duration,
            operator.cost,
            tuple(_term(each, names) for each in operator.resources),
            renamed(stride.needs),
            renamed(stride.makes),
            renamed(stride.ends),
            tuple(_atom(each, names) for each in read),
            draws,
            item,
        )


def _name_places(visits: Iterable[Visit], place: int) -> dict[Term, Term]:
    """What the places of a route are called during an act."""
    found: dict[Term, Term] = {}
    for hold, named, got in visits:
        if (hold.first is None or hold.first <= place) and (
            hold.last is None or place <= hold.last
        ):
            if found.get(named, got) != got:
                raise Mislaid(f"one act leaves {named} and takes it again")
            found[named] = got
    return found


def _atom(atom: Atom, names: Names) -> Function:
    return Function(atom.name, tuple(_term(each, names) for each in atom.arguments))


def _term(term: Term, names: Names) -> Term:
    if term in names:
        return names[term]
    if isinstance(term, Function) and term.arguments:
        return Function(term.name, tuple(_term(each, names) for each in term.arguments))
    return term


def plan_of_steps(
    cell: CellFlow, steps: Sequence[FlowStep], initial: Mapping[Function, int]
) -> Plan:
    """The plan of steps in the order of their starts, with its causal links. `initial` has the
    quantities at the start.

    No step waits for one that has not ended when it starts.
    """
    order, links = _Order(), _Links()
    levels = dict(initial)
    made: list[Step] = []
    for number, step in enumerate(steps):
        needs, adds, ends = _with_levels(step, levels)
        order.note(number, needs, adds, ends, (*step.resources, Number(step.item)))
        links.note(number, step, needs, adds, ends)
        made.append(
            Step(StepId(number + 1), step.instance, (), step.resources, step.duration, step.cost)
        )
    wanted = [atom for item in range(len(cell.flow.items)) for atom in _goals(cell, item)]
    causal = [*links.links, *links.at_the_end(wanted)]
    for producer, _, consumer in links.links:
        if int(producer) > 0 and int(consumer) > 0:
            order.before[int(consumer) - 1].add(int(producer) - 1)
    ordered = (
        replace(step, after=tuple(StepId(n + 1) for n in direct))
        for step, direct in zip(made, order.reduced(), strict=True)
    )
    return Plan(tuple(ordered), tuple(CausalLink(*link) for link in dict.fromkeys(causal)))


def _goals(cell: CellFlow, item: int) -> Iterator[Atom]:
    """What must hold at the end for an item."""
    number = cell.flow.items[item].route
    kind, subject = cell.kinds[number], cell.subjects[item]
    last = cell.final_state(number)
    goal = next(each for each in kind.task.goals if not each & ~last)
    if kind.task.axioms is not None:
        goal = kind.task.axioms.support(last, goal)
    names: dict[Term, Term] = dict(kind.members[subject])
    own = [chain.name for chain in cell.problem.chains if chain.subject == subject]
    names.update((Text(one), Text(other)) for one, other in zip(kind.chains, own, strict=True))
    return (_atom(each, names) for each in kind.task.names(goal))


def _with_levels(
    step: FlowStep, levels: dict[Function, int]
) -> tuple[tuple[Atom, ...], tuple[Atom, ...], tuple[Atom, ...]]:
    """What a step needs, adds and ends, the values of quantities included, which it changes."""
    needs, adds, ends = list(step.needs), list(step.adds), list(step.ends)
    needs += [_value(quantity, levels[quantity]) for quantity in step.reads]
    for quantity, change in step.draws:
        if change:
            ends.append(_value(quantity, levels[quantity]))
            levels[quantity] += change
            adds.append(_value(quantity, levels[quantity]))
    return tuple(needs), tuple(adds), tuple(ends)


def _value(quantity: Function, value: int) -> Function:
    return Function(quantity.name, (*quantity.arguments, Number(value)))


@dataclass
class _Order:
    """Which steps must not overlap: those that hold the same, and those that deny what others add
    or need.

    For each atom, steps that touch it and steps that deny it come in turns, and each waits for
    those of the turn before.
    """

    before: list[set[int]] = field(default_factory=list)
    turns: dict[Atom, tuple[bool, list[int], list[int]]] = field(default_factory=dict)
    holding: dict[Term, int] = field(default_factory=dict)

    def note(
        self,
        number: int,
        needs: Sequence[Atom],
        adds: Sequence[Atom],
        ends: Sequence[Atom],
        resources: Iterable[Term],
    ) -> None:
        """Add the next step."""
        waits = set[int]()
        for atoms, denies in (((*needs, *adds), False), (ends, True)):
            for atom in atoms:
                denied, turn, last = self.turns.get(atom, (denies, [], []))
                if denied != denies:
                    denied, turn, last = denies, [], turn
                waits.update(last)
                if not turn or turn[-1] != number:
                    turn = [*turn, number]
                self.turns[atom] = denied, turn, last
        for resource in resources:
            if resource in self.holding:
                waits.add(self.holding[resource])
            self.holding[resource] = number
        waits.discard(number)
        self.before.append(waits)

    def reduced(self) -> Iterator[list[int]]:
        """For each step those that come directly before it: the transitive reduction."""
        ancestors: list[Bits] = []
        for earlier in self.before:
            covered, direct = 0, list[int]()
            for last in sorted(earlier, reverse=True):
                if not covered >> last & 1:
                    direct.append(last)
                    covered |= ancestors[last] | 1 << last
            ancestors.append(covered)
            yield sorted(direct)


@dataclass
class _Links:
    """Who achieves what steps need: the first step from which on it stays true, and which has
    ended by then.
    """

    links: list[tuple[StepId, Atom, StepId]] = field(default_factory=list)
    producers: dict[Atom, list[tuple[int, int]]] = field(default_factory=dict)  # number and end

    def note(
        self,
        number: int,
        step: FlowStep,
        needs: Sequence[Atom],
        adds: Sequence[Atom],
        ends: Sequence[Atom],
    ) -> None:
        """Add the next step."""
        self.links += [
            (self._producer(atom, step.start), atom, StepId(number + 1)) for atom in needs
        ]
        for atom in ends:
            self.producers[atom] = []
        for atom in adds:
            self.producers.setdefault(atom, []).append((number, step.end))

    def _producer(self, atom: Atom, start: int) -> StepId:
        known = self.producers.get(atom)
        if known is None:
            return INITIAL_STEP
        if not known:
            raise Mislaid(f"nothing achieves {atom}")
        ended = (number for number, end in known if end <= start)
        return StepId(next(ended, known[0][0]) + 1)

    def at_the_end(self, goals: Iterable[Atom]) -> Iterator[tuple[StepId, Atom, StepId]]:
        """The links to the goals."""
        for atom in goals:
            yield self._producer(atom, FOREVER), atom, GOAL_STEP
