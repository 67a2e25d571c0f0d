"""Pruning: drops irrelevant objects and operators, and proves that plans stay as short as before.

What is relevant is found backwards over operators with variables. Objects that are alike there, and
that play no part, are left out except for a few. Then the rest is grounded, and what contributes to
no goal is left out, too. Whether the small task is as good as the whole one is proved on it; where
it is not, the caller grounds the whole.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.grounding.goal_relevance import find_relevance
from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.kb.asp.excerpt import excerpt_problem
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.asp.static_program import VIOLATED
from cellwright.kb.model.domain_model import BUILT_IN_TYPES, NUMERIC_TYPES, Domain
from cellwright.kb.model.object_likeness import (
    alike_objects,
    constant_names,
    free_objects,
    most_at_once,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, exchange_subterms

Named = Callable[[str, int], Iterable[Atom]]  # the static facts of a predicate of an arity
Spares = tuple[tuple[str, ...], ...]  # of each class of objects that are alike those that stay


@dataclass(frozen=True, slots=True)
class ThinnedProblem:
    """A problem without some objects that are alike; `spares` are those of each class that are
    still there.
    """

    problem: Problem
    left_out: frozenset[str] = frozenset()
    spares: Spares = ()


def drop_irrelevant_objects(
    problem: Problem, statics: Named | None = None, few: Problem | None = None
) -> ThinnedProblem:
    """The problem without objects that play no part, from its initial state.

    It is the same problem if there are no such objects, or if grounding has to report something.
    `statics` gives the evaluated static facts, and `few` the excerpt of the problem, if they are
    known already.
    """
    few = few or excerpt_problem(problem)
    thinned_problem = _drop_unneeded(few, statics if few is problem else None)
    if thinned_problem is None:
        return ThinnedProblem(problem)
    return replace(
        thinned_problem,
        left_out=thinned_problem.left_out | (problem.objects.keys() - few.objects.keys()),
    )


def _drop_unneeded(problem: Problem, statics: Named | None) -> ThinnedProblem | None:
    free, most = _plentiful_objects(problem)
    if not free:
        return None
    named, state = _initial_facts(problem, statics)
    if state is None or any(True for _ in named(VIOLATED, 1)):
        return None
    needed = find_relevance(problem)
    facts = [
        fact for name, arity in sorted(needed.static_predicates) for fact in named(name, arity)
    ]
    read = (fact for fact in facts if needed.reads(fact))
    classes = alike_objects(free, (*read, *(atom for atom in state if needed.concerns(atom))))
    spares = tuple(alike[: most[free[alike[0]]]] for alike in classes)
    gone = frozenset(
        name for own, spare in zip(classes, spares, strict=True) for name in own[len(spare) :]
    )
    return (
        ThinnedProblem(_without_objects(problem, gone, facts, state, named), gone, spares)
        if gone
        else None
    )


def _plentiful_objects(problem: Problem) -> tuple[dict[str, str], dict[str, int]]:
    """The free objects, with their types, of which there are more than can matter at once; and how
    many that are, by type.

    Objects of the other types all stay, so what a fact says about one of them ties nothing.
    """
    free = free_objects(problem)
    most = {type_: 1 + most_at_once(problem.domain, type_) for type_ in set(free.values())}
    counts = Counter(free.values())
    return {name: type_ for name, type_ in free.items() if counts[type_] > most[type_]}, most


def _initial_facts(
    problem: Problem, statics: Named | None
) -> tuple[Named, tuple[Atom, ...] | None]:
    """The static facts, unless they are known, and the initial state; None for facts that
    contradict each other.
    """
    state, contradicted = initial_state(problem, ChangingPredicates(problem.domain))

    def named(name: str, arity: int) -> Iterable[Atom]:
        return evaluate_statics(problem).facts(name, arity)

    return statics or named, None if contradicted else state


def _without_objects(
    problem: Problem,
    gone: frozenset[str],
    facts: Iterable[Atom],
    state: Iterable[Atom],
    named: Named,
) -> Problem:
    """The problem without some objects, with all its static facts evaluated."""
    domain = problem.domain
    words = domain.conventions
    ways = (*named(words.position, 4), *named(words.travel, 3))
    all_statics = [*facts, *ways, *problem.statics, *_numbered_terms(domain, named)]
    staying = _StayingObjects(gone)
    return replace(
        problem,
        domain=replace(domain, asp=(), objects=staying.objects(domain.objects)),
        objects=staying.objects(problem.objects),
        statics=tuple(dict.fromkeys(fact for fact in all_statics if staying.fact(fact))),
        initial=tuple(atom for atom in state if staying.fact(atom)),
        complete=True,
    )


@dataclass(frozen=True, slots=True)
class _StayingObjects:
    gone: frozenset[str]

    def fact(self, atom: Atom) -> bool:
        return self.gone.isdisjoint(constant_names(atom))

    def objects(self, types: Mapping[str, str]) -> dict[str, str]:
        return {name: type_ for name, type_ in types.items() if name not in self.gone}


def _numbered_terms(domain: Domain, named: Named) -> Iterable[Atom]:
    """Which terms with numbers in them have which type: facts and rules of the problem say so."""
    if any(
        argument in NUMERIC_TYPES
        for function in domain.functions.values()
        for argument in function.arguments
    ):
        for type_ in domain.types:
            if type_ not in BUILT_IN_TYPES:
                for fact in named(type_, 1):
                    if isinstance(fact.arguments[0], Function) and fact.arguments[0].arguments:
                        yield fact


def drop_irrelevant_operators(task: GroundTask) -> GroundTask:
    """The task without operators that contribute to no goal, whatever else is done."""
    wanted_atoms = 0
    for goal in task.goals:
        wanted_atoms |= goal
    waiting: list[GroundOperator] = list(task.operators)
    if task.axioms is not None:
        wanted_atoms |= task.axioms.read

    def achieves(operator: GroundOperator) -> Bits:
        return _achieved_atoms(operator) | (
            task.axioms.helps(operator.changes) if task.axioms else 0
        )

    grown = True
    while grown:
        grown, rest = False, []
        for operator in waiting:
            if achieves(operator) & wanted_atoms:
                more = _needed_atoms(operator) & ~wanted_atoms
                wanted_atoms, grown = wanted_atoms | more, grown or bool(more)
            else:
                rest.append(operator)
        waiting = rest
    useful_operators = tuple(
        operator for operator in task.operators if achieves(operator) & wanted_atoms
    )
    return replace(task, operators=useful_operators)


def _achieved_atoms(operator: GroundOperator) -> Bits:
    adds = operator.adds
    for effect in operator.conditional:
        adds |= effect.adds
    return adds


def _needed_atoms(operator: GroundOperator) -> Bits:
    needs = operator.preconditions
    for effect in operator.conditional:
        needs |= effect.condition
    return needs


def preserves_optimality(task: GroundTask, spares: Sequence[tuple[str, ...]]) -> bool:
    """Whether the shortest plans of a thinned task are as short as those of the whole one, and
    exist where they exist.
    """
    if task.axioms is not None or any(operator.conditional for operator in task.operators):
        return False
    return all(_MergedSpares(task, own).fits() for own in spares if len(own) > 1)


@dataclass
class _MergedSpares:
    """A task in which every spare object is read as the first one."""

    task: GroundTask
    spares: tuple[str, ...]

    def fits(self) -> bool:
        """Whether every step can be read so."""
        task = self.task
        start = all(
            task.initial >> self.image[n] & 1
            for n in indices(task.initial & self.relevant)
            if n in self.image
        )
        whole = all(n in self.image for n in indices(self.relevant))
        return whole and start and self._goals() and all(map(self._readable, task.operators))

    def _goals(self) -> bool:
        return all(
            any(goal & ~self._read(other_goal) == 0 for goal in self.task.goals)
            for other_goal in self.task.goals
        )

    @cached_property
    def relevant(self) -> Bits:
        """The atoms that goals and steps need."""
        relevant_atoms = 0
        for goal in self.task.goals:
            relevant_atoms |= goal
        for operator in self.task.operators:
            relevant_atoms |= operator.preconditions
        return relevant_atoms

    @cached_property
    def image(self) -> dict[int, int]:
        """For each atom the one that it is read as, if there is such an atom."""
        index = {atom: number for number, atom in enumerate(self.task.atoms)}
        pairs = ((n, index.get(self._renamed(atom))) for n, atom in enumerate(self.task.atoms))
        return {number: image_atom for number, image_atom in pairs if image_atom is not None}

    @cached_property
    def sources(self) -> Mapping[int, list[int]]:
        """For each atom those that are read as it."""
        source_atoms: dict[int, list[int]] = defaultdict(list)
        for number, image in self.image.items():
            source_atoms[image].append(number)
        return source_atoms

    @cached_property
    def by_instance(self) -> Mapping[Function, list[GroundOperator]]:
        operators_by_instance: dict[Function, list[GroundOperator]] = defaultdict(list)
        for operator in self.task.operators:
            operators_by_instance[operator.instance].append(operator)
        return operators_by_instance

    @cached_property
    def exclusive(self) -> Mapping[int, Bits]:
        """For each atom those that are never true together with it."""
        excluded_atoms: dict[int, Bits] = defaultdict(int)
        for group in self.task.mutex_groups:
            for number in indices(group):
                excluded_atoms[number] |= group & ~(1 << number)
        return excluded_atoms

    @cached_property
    def first(self) -> Mapping[Term, Term]:
        """The first spare in the place of each other one."""
        return {Function(name): Function(self.spares[0]) for name in self.spares[1:]}

    def _renamed(self, atom: Atom) -> Atom:
        return Function(
            atom.name, tuple(exchange_subterms(argument, self.first) for argument in atom.arguments)
        )

    def _read(self, atoms: Bits) -> Bits:
        return bitset([self.image[n] for n in indices(atoms) if n in self.image])

    def _readable(self, operator: GroundOperator) -> bool:
        """Whether a step, read so, is a step that serves as well; or changes nothing that
        matters.
        """
        adds = self._read(operator.adds & self.relevant)
        needs = self._read(operator.preconditions)
        if adds & ~needs == 0:
            return True
        return any(
            twin.preconditions & ~needs == 0
            and adds & ~(twin.adds | needs & ~twin.deletes) == 0
            and twin.cost <= operator.cost
            and not any(self._lost(operator, twin))
            for twin in self.by_instance.get(self._renamed(operator.instance), ())
        )

    def _lost(self, operator: GroundOperator, image: GroundOperator) -> Iterator[bool]:
        """For each atom that the image ends: whether a step leaves one that is read as it."""
        for ended in indices(image.deletes & ~image.adds & self.relevant):
            for source in self.sources.get(ended, ()):
                changed = (operator.deletes | operator.adds) >> source & 1
                yield not changed and not self.exclusive.get(source, 0) & operator.preconditions


__all__ = [
    "Named",
    "ThinnedProblem",
    "drop_irrelevant_objects",
    "drop_irrelevant_operators",
    "find_relevance",
    "preserves_optimality",
]
