"""The route of one object from its ground task: its shortest ways, with the arms, machines and
places to choose from.

The task has this object alone. So places are free, and what others do to it is left out: they only
hold places and resources. A path with the fewest steps leads to the goal; all such paths with the
fewest acts are the route. An act is one step, or what an arm does from picking something up until
it is free again.

What is no place, as a door that somebody has to open first, is not followed. Then there is no
route, or `NoRoute` says why.
"""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.flow import Act, Leave, Route, Take, Use
from cellwright.engine.model.ground_axioms import Comparing
from cellwright.engine.model.ground_task import GroundOperator, GroundTask, progress_state
from cellwright.engine.model.workflow_replay import (
    STAGE_FLUENT,
    reaching_operators,
    settling_operators,
)
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured, arms_to, contains_term
from cellwright.kb.terms import Function, Term

MAX_NODES = 200_000  # states of one object
NOWHERE = "no way of one object leads to its goal by what is done with it alone"
LONGEST_ACT = 8  # steps of an arm from home to home


class NoRoute(Exception):
    """An object whose ways through the cell are not followed. The message says why."""


@dataclass(frozen=True, slots=True)
class Stride:
    """A step of one object in a state: its plain operator, what it needs, ends and makes there,
    and what it compares and changes.
    """

    operator: GroundOperator
    needs: Bits
    ends: Bits
    makes: Bits
    compared: Bits = 0

    @property
    def duration(self) -> int:
        """How long the step lasts."""
        return self.operator.duration


@dataclass(frozen=True, slots=True)
class Edge:
    """Strides from one node to another."""

    before: int
    after: int
    strides: tuple[Stride, ...]

    @property
    def duration(self) -> int:
        """The sum of the durations of the steps."""
        return sum(each.duration for each in self.strides)

    @property
    def timed(self) -> Iterator[tuple[Stride, int, int]]:
        """Each stride with its begin and end, counted from the start of the edge."""
        now = 0
        for each in self.strides:
            yield each, now, now + each.duration
            now += each.duration


@dataclass
class ObjectGraph:
    """The ways of the object `subject` through its own ground task. Raises `NoRoute`."""

    task: GroundTask
    subject: Term
    nodes: list[Bits] = field(default_factory=list)

    def __post_init__(self) -> None:
        if any(each.conditional for each in self.task.operators):
            raise NoRoute("steps have conditional effects")

    @cached_property
    def own(self) -> Bits:
        """The atoms about the object, its stages included."""
        atoms = self.task.atoms
        return bitset(
            [
                n
                for n, atom in enumerate(atoms)
                if atom.name == STAGE_FLUENT or contains_term(atom, self.subject)
            ]
        )

    @cached_property
    def tests(self) -> Mapping[int, Comparing]:
        """The atoms that compare quantities."""
        return {each.atom: each for each in self.task.axioms.tests} if self.task.axioms else {}

    @cached_property
    def compared(self) -> Bits:
        """The atoms that compare quantities, and their complementary ones."""
        found = bitset(list(self.tests))
        if self.task.axioms:
            found |= bitset(
                [
                    self.task.axioms.complements[n]
                    for n in self.tests
                    if n in self.task.axioms.complements
                ]
            )
        return found

    def test_of(self, atom: int) -> tuple[Comparing, bool]:
        """The comparison of an atom, and whether it must be true."""
        if atom in self.tests:
            return self.tests[atom], True
        assert self.task.axioms is not None
        return self.tests[self.task.axioms.opposite[atom]], False

    @cached_property
    def values(self) -> Bits:
        """The atoms that are values of quantities."""
        found = 0
        for operator in self.task.operators:
            for change in operator.changes:
                found |= change.level.mask
        return found

    @cached_property
    def moving(self) -> list[GroundOperator]:
        """The operators that do something with the object."""
        return [
            each
            for each in self.task.operators
            if not each.instance.name.startswith("_")
            and (
                contains_term(each.instance, self.subject) or (each.adds | each.deletes) & self.own
            )
        ]

    @cached_property
    def _keyed(self) -> dict[int, list[GroundOperator]]:
        """The operators of the object by the atom that fewest of them need; those that need
        nothing by -1.
        """
        count: dict[int, int] = {}
        derived = self.task.axioms.derived if self.task.axioms else 0
        for each in self.moving:
            for atom in indices(each.preconditions & ~derived):
                count[atom] = count.get(atom, 0) + 1
        found: dict[int, list[GroundOperator]] = {}
        for each in self.moving:
            key = min(
                indices(each.preconditions & ~derived), key=lambda a: (count[a], a), default=-1
            )
            found.setdefault(key, []).append(each)
        return found

    @cached_property
    def _reaching(self) -> list[GroundOperator]:
        return reaching_operators(self.task)

    def start(self) -> Bits:
        """The first state, with the stages that are reached in it."""
        state = self.task.initial
        for each in settling_operators(state, self._reaching):
            state = progress_state(state, each)
        return state

    def strides(self, state: Bits) -> Iterator[tuple[Stride, Bits]]:
        """What can be done with the object in a state, each with the state after it."""
        keyed = self._keyed
        for key in (-1, *(atom for atom in indices(state) if atom in keyed)):
            for operator in keyed.get(key, ()):
                if not operator.preconditions & ~self.compared & ~state:
                    yield self._stride(state, operator)

    def _stride(self, state: Bits, operator: GroundOperator) -> tuple[Stride, Bits]:
        task, compared = self.task, operator.preconditions & self.compared
        needs = operator.preconditions & ~compared
        if task.axioms is not None and needs & task.axioms.derived:
            needs = task.axioms.support(state, needs)
            if needs & self.values:
                raise NoRoute("rules look at quantities")
        plain = replace(operator, changes=())
        after = task.after(state, plain)
        reached = 0
        for each in settling_operators(after, self._reaching):
            reached |= each.preconditions & state & ~operator.adds
            after = task.after(after, each)
        derived = task.axioms.derived if task.axioms else 0
        fluent = ~(derived | self.compared | self.values)
        ends, makes = state & ~after & fluent, after & ~state & fluent
        return Stride(operator, (needs | reached) & fluent, ends, makes, compared), after

    def is_goal(self, state: Bits) -> bool:
        """Whether a goal holds in a state."""
        return any(not goal & ~state for goal in self.task.goals)


@dataclass(frozen=True, slots=True)
class Ways:
    """The edges of all shortest ways, by layer, from node 0 on, and the states of their nodes."""

    layers: tuple[tuple[Edge, ...], ...]
    states: Mapping[int, Bits]


def ways_of(graph: ObjectGraph) -> Ways:
    """All ways with the fewest steps, and of these with the fewest acts. Raises `NoRoute`."""
    return _Spread(graph).ways()


@dataclass
class _Spread:
    """The nodes of a graph in the order of steps and acts on the way to them (Dijkstra), with
    the edges that lead there.
    """

    graph: ObjectGraph

    def __post_init__(self) -> None:
        begin = self.graph.start()
        self.number, self.states = {begin: 0}, [begin]
        self.least: dict[int, tuple[int, int]] = {0: (0, 0)}
        self.into: dict[int, list[Edge]] = {}
        self.waiting = [(0, 0, 0)]
        self.left = _steps_left(self.graph)
        if begin not in self.left:
            raise NoRoute(NOWHERE)

    def ways(self) -> Ways:
        """The ways to the nearest goals."""
        about = _arm_atoms(self.graph, self._first_way())
        done, ends = set[int](), list[int]()
        best: tuple[int, int] | None = None
        while self.waiting:
            steps, acts, node = heapq.heappop(self.waiting)
            if best is not None and (steps, acts) > best:
                break
            if node in done:
                continue
            done.add(node)
            if self.graph.is_goal(self.states[node]):
                best = (steps, acts)
                ends.append(node)
            else:
                self._expand(node, about)
        if not ends:
            raise NoRoute(NOWHERE)
        return _pruned(ends, self.into, self.least, self.states)

    def _nearer(self, state: Bits) -> Iterator[tuple[Stride, Bits]]:
        """What can be done in a state on a shortest way."""
        for stride, after in self.graph.strides(state):
            if self.left.get(after, -1) == self.left[state] - 1:
                yield stride, after

    def _first_way(self) -> list[GroundOperator]:
        """The operators of one way with the fewest steps."""
        state, found = self.states[0], list[GroundOperator]()
        while self.left[state]:
            stride, state = next(self._nearer(state))
            found.append(stride.operator)
        return found

    def _acts(self, state: Bits, about: Bits) -> Iterator[tuple[tuple[Stride, ...], Bits]]:
        """The acts from a state in which the arms are at home to others, each with the state
        after it.
        """
        home = self.states[0] & about
        line: list[tuple[tuple[Stride, ...], Bits]] = [((), state)]
        for strides, here in line:
            for stride, after in self._nearer(here):
                if after & about == home:
                    yield (*strides, stride), after
                elif len(strides) + 1 < LONGEST_ACT:
                    line.append(((*strides, stride), after))

    def _expand(self, node: int, about: Bits) -> None:
        """Note the acts from a node."""
        steps, acts = self.least[node]
        for strides, after in self._acts(self.states[node], about):
            if after not in self.number:
                if len(self.states) > MAX_NODES:
                    raise NoRoute("an object can be in too many states")
                self.number[after] = len(self.states)
                self.states.append(after)
            there, reached = self.number[after], (steps + len(strides), acts + 1)
            self.into.setdefault(there, []).append(Edge(node, there, strides))
            if there not in self.least or reached < self.least[there]:
                self.least[there] = reached
                heapq.heappush(self.waiting, (*reached, there))


def _steps_left(graph: ObjectGraph) -> dict[Bits, int]:
    """The least number of steps from each state to a goal, where there is a way to one (breadth
    first, and back).
    """
    begin = graph.start()
    back: dict[Bits, list[Bits]] = {begin: []}
    line, left = [begin], dict[Bits, int]()
    for state in line:
        if graph.is_goal(state):
            left[state] = 0
            continue
        for _, after in graph.strides(state):
            if after not in back:
                back[after] = []
                line.append(after)
            back[after].append(state)
        if len(line) > MAX_NODES:
            raise NoRoute("an object can be in too many states")
    return _counted_back(back, left)


def _counted_back(back: Mapping[Bits, Sequence[Bits]], left: dict[Bits, int]) -> dict[Bits, int]:
    """The steps that are left in each state, from those in which some are known, backward."""
    nearer = list(left)
    for state in nearer:
        for before in back[state]:
            if before not in left:
                left[before] = left[state] + 1
                nearer.append(before)
    return left


def _arm_atoms(graph: ObjectGraph, way: Sequence[GroundOperator]) -> Bits:
    """The atoms about arms that carry the object: resources that are taken by one step and free
    after another.
    """
    try:
        arms = arms_to(way, graph.moving, (graph.subject,))
    except Unstructured:
        return 0
    carrying = [arm for arm in arms if _carries(graph, arm)]
    return bitset(
        [
            n
            for n, atom in enumerate(graph.task.atoms)
            if any(contains_term(atom, arm) for arm in carrying)
        ]
    )


def _carries(graph: ObjectGraph, arm: Term) -> bool:
    """Whether some steps take the resource and others give it back."""
    about = bitset(
        [
            n
            for n, a in enumerate(graph.task.atoms)
            if contains_term(a, arm) and not contains_term(a, graph.subject)
        ]
    )
    steps = [each for each in graph.moving if arm in each.resources]
    return any(each.deletes & about for each in steps) and any(each.adds & about for each in steps)


def _pruned(
    ends: Sequence[int],
    into: Mapping[int, Sequence[Edge]],
    least: Mapping[int, tuple[int, int]],
    states: Sequence[Bits],
) -> Ways:
    """What lies on a shortest way."""
    wanted, kept = list(ends), set(ends)
    layers: dict[int, list[Edge]] = {}
    for node in wanted:
        for edge in into.get(node, ()):
            steps, acts = least[edge.before]
            if (steps + len(edge.strides), acts + 1) == least[node]:
                layers.setdefault(acts, []).append(edge)
                if edge.before not in kept:
                    kept.add(edge.before)
                    wanted.append(edge.before)
    ordered = tuple(tuple(layers[n]) for n in range(len(layers)))
    return Ways(ordered, {node: states[node] for node in kept})


def key_of(atom: Function) -> str:
    """What a place is called whose atom says that it is free: by the only term in it, else by
    the atom.
    """
    return str(atom.arguments[0]) if len(atom.arguments) == 1 else str(atom)


@dataclass(frozen=True)
class RouteMaker:
    """Makes a route of ways.

    `places` leads from each place that is exchangeable to the one that stands for it.
    """

    graph: ObjectGraph
    ways: Ways
    stays: Mapping[Term, int]

    @cached_property
    def shared(self) -> Bits:
        """The atoms not about the object that its acts change."""
        found = 0
        for layer in self.ways.layers:
            for edge in layer:
                for each in edge.strides:
                    found |= each.ends | each.makes
        return found & ~self.graph.own

    @cached_property
    def held(self) -> Bits:
        """The places that the object has at the start: not free then, and given back by it."""
        given = 0
        for layer in self.ways.layers:
            for edge in layer:
                for each in edge.strides:
                    given |= each.makes
        return given & self.shared & ~self.ways.states[0] & self._given_first

    @cached_property
    def _given_first(self) -> Bits:
        """The shared atoms that some way gives back before it takes them."""
        first, taken = 0, {0: 0}
        for layer in self.ways.layers:
            for edge in layer:
                now = taken[edge.before]
                for each in edge.strides:
                    first |= each.makes & self.shared & ~now
                    now |= each.ends & self.shared
                taken[edge.after] = taken.get(edge.after, 0) | now
        return first

    def route(
        self,
        kept: frozenset[str],
        names: Mapping[str, str],
        extra: Callable[[Stride], Sequence[str]],
    ) -> tuple[Route, tuple[tuple[Edge, ...], ...]]:
        """The route over places that are `kept`, with the edge of each act. Raises `NoRoute`.

        `names` leads from each place to what it is a unit of; `extra` are resources that a stride
        holds beside its own.
        """
        held = tuple(names.get(k, k) for k in self._keys(self.held))
        number, standing = {0: 0}, {0: frozenset(held)}
        layers, edges = [], []
        for layer in self.ways.layers:
            acts, own = list[Act](), list[Edge]()
            for edge in layer:
                if edge.before not in number or not self._is_kept(edge, kept):
                    continue
                number.setdefault(edge.after, len(number))
                act = self._act(edge, number, names, standing[edge.before], extra)
                left = {each.place for each in act.leaves}
                if not left <= standing[edge.before]:
                    raise NoRoute(f"{act.name} gives back what it has not taken")
                now = standing[edge.before] - left | {each.place for each in act.takes}
                if standing.setdefault(edge.after, now) != now:
                    raise NoRoute("what an object holds depends on its way")
                acts.append(replace(act, number=len(acts)))
                own.append(edge)
            layers.append(tuple(acts))
            edges.append(tuple(own))
        stays = {
            names.get(self._key(n), self._key(n)): most
            for n in indices(self.shared)
            for most in [self.limit(self.graph.task.atoms[n])]
            if most is not None
        }
        return Route(tuple(layers), held, stays), tuple(edges)

    def limit(self, place: Term) -> int | None:
        """How long an object may stay in a place; None if it may for ever."""
        return min(
            (most for each, most in self.stays.items() if contains_term(place, each)), default=None
        )

    def _key(self, number: int) -> str:
        return key_of(self.graph.task.atoms[number])

    def _keys(self, bits: Bits) -> list[str]:
        return [self._key(n) for n in indices(bits)]

    def _is_kept(self, edge: Edge, kept: frozenset[str]) -> bool:
        return all(
            key in kept for each in edge.strides for key in self._keys(each.ends & self.shared)
        )

    def places(self) -> list[str]:
        """Every place that some act takes or gives back."""
        return self._keys(self.shared)

    def _act(
        self,
        edge: Edge,
        number: Mapping[int, int],
        names: Mapping[str, str],
        standing: frozenset[str],
        extra: Callable[[Stride], Sequence[str]],
    ) -> Act:
        taken: dict[str, tuple[int, int]] = {}
        uses: list[Use] = []
        leaves: list[Leave] = []
        for stride, begin, end in edge.timed:
            for key, ends, makes in self._touched(stride, names):
                if ends and key in taken:
                    raise NoRoute(f"{stride.operator.instance} takes {key} twice")
                if ends:
                    taken[key] = begin, end
                elif makes and key not in taken:
                    leaves.append(Leave(key, begin, end))
                else:
                    uses.append(Use(key, taken.pop(key)[0] if makes else begin, end))
            uses += [Use(key, begin, end) for key in extra(stride)]
            held = (str(each) for each in stride.operator.resources if each != self.graph.subject)
            uses += [Use(names.get(key, key), begin, end) for key in held]
        takes = [Take(key, *times) for key, times in taken.items()]
        said = " ".join(dict.fromkeys(each.operator.instance.name for each in edge.strides))
        cost = sum(each.operator.cost for each in edge.strides)
        left = {each.place: each.end for each in leaves}
        covers = {place: (0, left.get(place, edge.duration)) for place in standing}
        covers |= {
            each.place: (each.begin, edge.duration) for each in takes if each.place not in covers
        }
        own = _united(uses, covers)
        return Act(
            said,
            edge.duration,
            number[edge.before],
            number[edge.after],
            0,
            own,
            tuple(takes),
            tuple(leaves),
            cost,
        )

    def _touched(
        self, stride: Stride, names: Mapping[str, str]
    ) -> Iterator[tuple[str, bool, bool]]:
        """Each place that a step needs free, ends or makes free, and which of the latter two it
        does.
        """
        for n in indices((stride.needs | stride.ends | stride.makes) & self.shared):
            ends = bool(stride.ends >> n & 1)
            if ends and not stride.needs >> n & 1:
                atom = self.graph.task.atoms[n]
                raise NoRoute(f"{stride.operator.instance} ends {atom}, which it does not need")
            yield names.get(self._key(n), self._key(n)), ends, bool(stride.makes >> n & 1)


def _united(uses: Sequence[Use], covers: Mapping[str, tuple[int, int]]) -> tuple[Use, ...]:
    """The uses of each resource without those in the times in which it is held; those that
    touch become one.
    """
    spans: dict[str, list[tuple[int, int]]] = {}
    for each in uses:
        spans.setdefault(each.resource, []).append((each.begin, each.end))
    found: list[Use] = []
    for resource, own in spans.items():
        joined: list[tuple[int, int]] = []
        for begin, end in sorted(own):
            if joined and begin <= joined[-1][1]:
                joined[-1] = joined[-1][0], max(joined[-1][1], end)
            else:
                joined.append((begin, end))
        low, high = covers.get(resource, (0, -1))
        found += [Use(resource, b, e) for b, e in joined if b < e and not (low <= b and e <= high)]
    return tuple(found)
