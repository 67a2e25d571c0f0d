"""Makes the scheduling problem of a workflow (a flow): the routes of each kind of object, found by
grounding one object alone.

Objects are of one kind if what is known of one is known of the other with other names of its own
places. So a thousand plates are grounded as one. The plan that comes of a flow passes the gate like
any other; so it is enough here to be mostly right.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.flow import Flow, Item, Route
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.timetable.flow_windows import (
    calendar_names,
    route_with_windows,
)
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.scheduling.flow.bounds import Demand
from cellwright.engine.stages.scheduling.flow.detours import with_waits
from cellwright.engine.stages.scheduling.flow.graph import (
    Edge,
    NoRoute,
    ObjectGraph,
    RouteMaker,
    key_of,
    ways_of,
)
from cellwright.engine.stages.scheduling.flow.levels import Levels, shortages
from cellwright.engine.stages.scheduling.place_holds import exchange_in_atom
from cellwright.engine.stages.scheduling.plan_blocks import contains_term
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import ALWAYS_TRUE
from cellwright.kb.model.object_likeness import constant_names
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.model.time_windows import TimeOfWork, TimeWindow
from cellwright.kb.terms import Atom, Function, Term, natural_key

Renaming = Mapping[Term, Term]


@dataclass(frozen=True)
class Kind:
    """Objects that differ in names: the first of them in a task of its own, and how each is
    renamed from it.
    """

    task: GroundTask
    maker: RouteMaker
    chains: tuple[str, ...]  # the names of the chains of the first one
    members: Mapping[Term, Renaming]


@dataclass(frozen=True)
class CellFlow:
    """The flow of a problem, and what its parts mean.

    `pools` has the places of each resource with several equal ones.
    """

    problem: Problem
    flow: Flow
    kinds: tuple[Kind, ...]
    subjects: tuple[Term, ...]
    pools: Mapping[str, tuple[Term, ...]]
    wishes: Wishes
    # of each kind and layer, by the number of the act
    edges: tuple[tuple[tuple[Edge, ...], ...], ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)  # what each place is a unit of

    def final_state(self, kind: int) -> Bits:
        """The state of the first object of a kind after a shortest way."""
        maker = self.kinds[kind].maker
        edges = self.edges[kind]
        return maker.ways.states[edges[-1][0].after] if edges else maker.ways.states[0]

    @property
    def levels(self) -> dict[Function, int]:
        """The quantities at the start."""
        found: dict[Function, int] = {}
        for kind in self.kinds:
            tests = kind.task.axioms.tests if kind.task.axioms else ()
            changes = [
                change.level for operator in kind.task.operators for change in operator.changes
            ]
            for level in (*changes, *(level for test in tests for level, _ in test.sum.parts)):
                for renaming in kind.members.values():
                    found[_renamed(level.quantity, renaming)] = level.of(kind.task.initial)
        return found


def _renamed(term: Function, names_: Renaming) -> Function:
    arguments = (
        names_.get(a, _renamed(a, names_) if isinstance(a, Function) else a) for a in term.arguments
    )
    return Function(term.name, tuple(arguments))


def cell_flow(problem: Problem, known: Semantics) -> CellFlow:
    """The flow of a problem whose objects do not need one another. Raises `NoRoute`."""
    _require_alone(problem)
    wishes = wishes_for(known)
    if wishes.travel or wishes.windows:
        raise NoRoute("ways between steps take time")
    kinds = _kinds(problem, wishes)
    _require_enough(kinds)
    return _assembled(problem, kinds, wishes)


class RunsOut(Exception):
    """What is there does not suffice for all objects, whatever is done.

    The message says what, and how much is missing.
    """


def _require_enough(kinds: Sequence[Kind]) -> None:
    """Raises `RunsOut` if a quantity that nothing fills up is less than what all objects draw
    from it at least.
    """
    if not any(operator.changes for kind in kinds for operator in kind.task.operators):
        return
    demands = [(Demand(kind.maker.graph, {}), len(kind.members)) for kind in kinds]
    subjects = [member for kind in kinds for member in kind.members]
    if any(each.arcs is None for each, _ in demands):
        return
    for shortage in shortages(demands):
        if not any(contains_term(shortage.quantity, subject) for subject in subjects):
            raise RunsOut(str(shortage))


def _require_alone(problem: Problem) -> None:
    if not problem.chains or any(chain.subject is None for chain in problem.chains):
        raise NoRoute("there is no workflow of single objects")
    if problem.goal != ALWAYS_TRUE or problem.durations or problem.complete:
        raise NoRoute("there are goals beside the workflow")
    subject = {chain.name: chain.subject for chain in problem.chains}
    for chain in problem.chains:
        if any(subject.get(before) != chain.subject for before in chain.after):
            raise NoRoute("objects wait for one another")
        if not chain.wanted:
            raise NoRoute("some events need not occur")


def subjects_in(problem: Problem) -> tuple[Term, ...]:
    """The objects of the workflow."""
    return tuple(
        dict.fromkeys(chain.subject for chain in problem.chains if chain.subject is not None)
    )


def meets_others(problem: Problem) -> bool:
    """Whether one step may do something with two objects of the workflow."""
    types = {
        problem.objects[str(each)] for each in subjects_in(problem) if str(each) in problem.objects
    }
    return any(
        sum(
            any(problem.domain.is_subtype(type_, each.type) for type_ in types)
            for each in operator.parameters
        )
        > 1
        for operator in problem.domain.operators
    )


@dataclass(frozen=True)
class _Known:
    """What is said of each object of the workflow: facts, and stages."""

    problem: Problem
    beside: frozenset[str]  # facts about times, which do not make another kind

    @cached_property
    def subjects(self) -> tuple[Term, ...]:
        return subjects_in(self.problem)

    @cached_property
    def facts(self) -> dict[str, list[tuple[int, Atom]]]:
        """The facts that name each object, statics with 0 and initial ones with 1."""
        wanted = {str(each) for each in self.subjects}
        found: dict[str, list[tuple[int, Atom]]] = {name: [] for name in wanted}
        for place, facts in enumerate((self.problem.statics, self.problem.initial)):
            for fact in facts:
                for name in wanted.intersection(constant_names(fact)):
                    if fact.name not in self.beside:
                        found[name].append((place, fact))
        return found

    @cached_property
    def chains(self) -> dict[Term, list[Chain]]:
        found: dict[Term, list[Chain]] = {each: [] for each in self.subjects}
        for chain in self.problem.chains:
            if chain.subject is not None:
                found[chain.subject].append(chain)
        return found

    @cached_property
    def private(self) -> dict[Term, Term]:
        """The places that facts of one object name, and of no other; objects of the problem, or
        what has arguments.
        """
        owners: dict[Term, set[str]] = {}
        for name, facts in self.facts.items():
            for _, fact in facts:
                for term in fact.arguments:
                    if isinstance(term, Function) and (
                        term.arguments or self._is_told_by_problem(term)
                    ):
                        owners.setdefault(term, set()).add(name)
        by_name = {str(each): each for each in self.subjects}
        return {term: by_name[next(iter(own))] for term, own in owners.items() if len(own) == 1}

    def _is_told_by_problem(self, term: Function) -> bool:
        """Whether a constant is an object that the problem alone names, and only in facts about
        one object of the workflow.
        """
        name = term.name
        return (
            name in self.problem.objects
            and name not in self.problem.domain.objects
            and name not in self._named
        )

    @cached_property
    def _named(self) -> frozenset[str]:
        """The names in facts about no object of the workflow, and the objects of the workflow."""
        subjects = {str(each) for each in self.subjects}
        found = set(subjects)
        for fact in (*self.problem.statics, *self.problem.initial):
            own = set(constant_names(fact))
            if own.isdisjoint(subjects):
                found |= own
        return frozenset(found)

    def outline(self, subject: Term) -> object:
        """What objects of one kind have in common."""
        facts = Counter(
            (place, self._masked(fact, subject)) for place, fact in self.facts[str(subject)]
        )
        stages = [
            (tuple(self._masked(stage, subject) for stage in chain.stages), len(chain.after))
            for chain in self.chains[subject]
        ]
        times = tuple(self._masked_window(window, subject) for window in self.problem.all_windows)
        work = tuple(self._masked(each.of, subject) for each in self.problem.all_calendars)
        type_ = self.problem.objects.get(str(subject))
        return type_, frozenset(facts.items()), tuple(stages), times, work

    def _masked_window(self, window: TimeWindow, subject: Term) -> object:
        """What a window says of an object: its events, and whether it is about this object."""
        events = (self._masked(pattern.atom, subject) for pattern in (window.earlier, window.later))
        return *events, tuple(subject in values for _, values in window.among)

    def _masked(self, term: Term, subject: Term) -> Term:
        if term == subject:
            return Function("_self")
        if not isinstance(term, Function):
            return term
        if self.private.get(term) == subject:
            if not term.arguments:
                return Function("_own", (Function(self.problem.objects[term.name]),))
            return Function("_own", (Function(term.name), *term.arguments[:-1]))
        return Function(term.name, tuple(self._masked(each, subject) for each in term.arguments))

    def own_places(self, subject: Term) -> list[Term]:
        """The places of an object of its own, in the order in which facts name them."""
        found = dict[Term, None]()
        for _, fact in sorted(self.facts[str(subject)], key=lambda e: (e[0], e[1].name)):
            found.update(dict.fromkeys(t for t in fact.arguments if self.private.get(t) == subject))
        return list(found)


def _kinds(problem: Problem, wishes: Wishes) -> tuple[Kind, ...]:
    words = problem.domain.conventions
    known = _Known(problem, frozenset({words.release, words.due, words.priority}))
    groups: dict[object, list[Term]] = {}
    for subject in known.subjects:
        groups.setdefault(known.outline(subject), []).append(subject)
    return tuple(_kind(known, members, wishes) for members in groups.values())


def _kind(known: _Known, members: Sequence[Term], wishes: Wishes) -> Kind:
    first = members[0]
    task = ground(_alone(known, first))
    graph = ObjectGraph(task, first)
    own = known.own_places(first)
    renamed = {m: dict(zip((first, *own), (m, *known.own_places(m)), strict=True)) for m in members}
    chains = tuple(chain.name for chain in known.chains[first])
    return Kind(
        task,
        RouteMaker(graph, with_waits(graph, ways_of(graph)), wishes.longest_stay),
        chains,
        renamed,
    )


def _alone(known: _Known, subject: Term) -> Problem:
    """The problem of one object alone."""
    problem = known.problem
    others = {str(each) for each in known.subjects if each != subject}

    def without(facts: Iterable[Atom]) -> tuple[Atom, ...]:
        return tuple(fact for fact in facts if others.isdisjoint(constant_names(fact)))

    return replace(
        problem,
        objects={name: type_ for name, type_ in problem.objects.items() if name not in others},
        statics=without(problem.statics),
        initial=without(problem.initial),
        chains=tuple(known.chains[subject]),
    )


@dataclass(frozen=True)
class _Pools:
    """Which places of all kinds of objects are equal."""

    kinds: Sequence[Kind]

    @cached_property
    def terms(self) -> dict[str, Term]:
        """The places that are terms, by their names."""
        found: dict[str, Term] = {}
        for kind in self.kinds:
            atoms = kind.task.atoms
            for number in indices(kind.maker.shared):
                if len(atoms[number].arguments) == 1:
                    found[key_of(atoms[number])] = atoms[number].arguments[0]
        return found

    def groups(self) -> list[tuple[str, ...]]:
        """The places, equal ones together, each group in the order of names."""
        beside = [_Equal(kind.maker, kind.task) for kind in self.kinds]
        found: list[list[str]] = []
        for key in sorted(self.terms, key=lambda each: natural_key(self.terms[each])):
            for group in found:
                one, other = self.terms[group[0]], self.terms[key]
                if not isinstance(one, Function) or not isinstance(other, Function):
                    continue
                if _like(one, other) and all(each.exchanges(one, other) for each in beside):
                    group.append(key)
                    break
            else:
                found.append([key])
        return [tuple(group) for group in found]


def _like(one: Term, other: Term) -> bool:
    """Whether two places have the same name but for their last part."""
    if not isinstance(one, Function) or not isinstance(other, Function):
        return False
    if not one.arguments or one.name != other.name:
        return False
    return one.arguments[:-1] == other.arguments[:-1] and len(one.arguments) == len(other.arguments)


@dataclass(frozen=True)
class _Equal:
    """Whether places can be exchanged on the ways of one kind of objects."""

    maker: RouteMaker
    task: GroundTask

    @cached_property
    def signatures(self) -> frozenset[object]:
        return frozenset(
            self._signed(n, edge, None)
            for n, layer in enumerate(self.maker.ways.layers)
            for edge in layer
        )

    @cached_property
    def _naming(self) -> dict[Term, list[tuple[int, Edge]]]:
        """The edges that name each place."""
        found: dict[Term, list[tuple[int, Edge]]] = {}
        for n, layer in enumerate(self.maker.ways.layers):
            for edge in layer:
                own = {a for each in edge.strides for a in each.operator.instance.arguments}
                for term in own:
                    found.setdefault(term, []).append((n, edge))
        return found

    def exchanges(self, one: Function, other: Function) -> bool:
        """Whether everything can be done with the other place in place of the one, and the
        reverse.
        """
        edges = [*self._naming.get(one, ()), *self._naming.get(other, ())]
        if self.maker.limit(one) != self.maker.limit(other):
            return False
        if not edges:
            return True
        return bool(self._naming.get(one)) == bool(self._naming.get(other)) and all(
            self._signed(n, edge, (one, other)) in self.signatures for n, edge in edges
        )

    def _signed(self, layer: int, edge: Edge, pair: tuple[Function, Function] | None) -> object:
        def swapped(term: Term) -> Term:
            return (
                term
                if pair is None or not isinstance(term, Function)
                else exchange_in_atom(Function("", (term,)), *pair).arguments[0]
            )

        def atoms(bits: Bits) -> frozenset[Term]:
            return frozenset(swapped(each) for each in self.task.names(bits & self.maker.shared))

        return layer, tuple(
            (
                swapped(each.operator.instance),
                each.duration,
                each.operator.cost,
                frozenset(map(swapped, each.operator.resources)),
                atoms(each.needs),
                atoms(each.ends),
                atoms(each.makes),
            )
            for each in edge.strides
        )


def _assembled(problem: Problem, kinds: tuple[Kind, ...], wishes: Wishes) -> CellFlow:
    pools = _Pools(kinds)
    groups = pools.groups()
    names_ = {key: group[0] for group in groups for key in group}
    spare = frozenset(key for group in groups for key in group[1:])
    own = {
        str(t) for kind in kinds for renaming in kind.members.values() for t in renaming.values()
    }
    first = {str(term) for kind in kinds for term in list(next(iter(kind.members.values())))}
    if foreign := [key for group in groups for key in group if key in own - first]:
        raise NoRoute(f"{foreign[0]} belongs to one object, and others may go there")
    levels = Levels(tuple((kind.task, kind.maker, len(kind.members)) for kind in kinds))
    made = []
    for kind in kinds:
        places = frozenset(kind.maker.places()) - spare
        route, edges = kind.maker.route(places, names_, levels.held)
        first_one = next(iter(kind.members))
        alone = _alone(_Known(problem, frozenset()), first_one)
        made.append((route_with_windows(alone, first_one, route, edges), edges))
    routes = tuple(route for route, _ in made)
    calendars = calendar_names(problem.all_calendars)
    capacity = _capacities(routes, {group[0]: len(group) for group in groups}, first, calendars)
    subjects = subjects_in(problem)
    number = {member: n for n, kind in enumerate(kinds) for member in kind.members}
    items = tuple(
        Item(
            str(s),
            number[s],
            wishes.release.get(s, 0),
            wishes.due.get(s),
            wishes.priority.get(s, 1),
        )
        for s in subjects
    )
    units = {
        group[0]: tuple(pools.terms[key] for key in group) for group in groups if len(group) > 1
    }
    return CellFlow(
        problem,
        Flow(routes, items, capacity, calendars),
        kinds,
        subjects,
        units,
        wishes,
        tuple(edges for _, edges in made),
        names_,
    )


def _capacities(
    routes: Sequence[Route],
    sizes: Mapping[str, int],
    own: set[str],
    calendars: Mapping[str, TimeOfWork],
) -> dict[str, int]:
    """The capacity of everything that routes hold, without the places of single objects."""
    named = dict[str, None]()
    for route in routes:
        named.update(dict.fromkeys(route.held))
        for act in (act for layer in route.layers for act in layer):
            named.update(dict.fromkeys(use.resource for use in act.uses))
            named.update(dict.fromkeys(take.place for take in act.takes))
    for name in calendars:
        named.pop(name, None)
    return {name: sizes.get(name, 1) for name in named if name not in own}
