"""Sets of ground atoms with indexes, and the solving of bodies over them by join.

The new set shares all predicates that the change does not touch, so a step costs only what it
touches.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

from cellwright.kb.arithmetic import (
    aggregate_key,
    compare_terms,
    evaluate_term,
    keys_relate,
    order_key,
    term_of,
)
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Literal,
    StateAggregate,
    substitute_part,
)
from cellwright.kb.model.domain_model import NUMERIC_TYPES, OBJECT_TYPE
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    is_ground,
    match_term,
    substitute_term,
)

MAX_SINGLE_LOOKUPS = 200  # atoms of a predicate that are asked for before all are read
SMALL_EXTENT = 4  # atoms; up to this number they are tried one by one


class PredicateExtent:
    """The atoms of one predicate.

    An index by argument is made at its first use; `after` passes it on to the new value.
    """

    __slots__ = ("_indexes", "atoms")

    def __init__(
        self,
        atoms: dict[Atom, None],
        indexes: dict[int, dict[Term, tuple[Atom, ...]]] | None = None,
    ) -> None:
        self.atoms = atoms
        self._indexes: dict[int, dict[Term, tuple[Atom, ...]]] = (
            indexes if indexes is not None else {}
        )

    def after(self, ends: Iterable[Atom], adds: Iterable[Atom]) -> "PredicateExtent":
        """The atoms without `ends` and with `adds`."""
        atoms = self.atoms.copy()
        indexes = {position: index.copy() for position, index in self._indexes.items()}
        for atom in ends:
            if atom in atoms:
                del atoms[atom]
                for position, index in indexes.items():
                    key = atom.arguments[position]
                    index[key] = tuple(member for member in index[key] if member != atom)
        for atom in adds:
            if atom not in atoms:
                atoms[atom] = None
                for position, index in indexes.items():
                    key = atom.arguments[position]
                    index[key] = (*index.get(key, ()), atom)
        return PredicateExtent(atoms, indexes)

    def where(self, position: int, value: Term) -> tuple[Atom, ...]:
        """The atoms whose argument at `position` is `value`."""
        index = self._indexes.get(position)
        if index is None:
            gathered: dict[Term, list[Atom]] = {}
            for atom in self.atoms:
                gathered.setdefault(atom.arguments[position], []).append(atom)
            index = self._indexes[position] = {
                key: tuple(own_atoms) for key, own_atoms in gathered.items()
            }
        return index.get(value, ())


NO_EXTENT = PredicateExtent({})


class FactSet:
    """Ground atoms, grouped by predicate, otherwise in the given order.

    Iteration yields all of them.
    """

    __slots__ = ("_extents",)

    def __init__(self, atoms: Iterable[Atom] = ()) -> None:
        gathered: dict[str, dict[Atom, None]] = {}
        for atom in atoms:
            gathered.setdefault(atom.name, {})[atom] = None
        self._extents = {name: PredicateExtent(own_atoms) for name, own_atoms in gathered.items()}

    def __contains__(self, atom: Atom) -> bool:
        return atom in self._extent(atom.name).atoms

    def __iter__(self) -> Iterator[Atom]:
        for extent in self._extents.values():
            yield from extent.atoms

    def _extent(self, name: str) -> PredicateExtent:
        return self._extents.get(name, NO_EXTENT)

    def atoms(self) -> frozenset[Atom]:
        """All atoms."""
        return frozenset().union(*(extent.atoms for extent in self._extents.values()))

    def after(self, ends: Collection[Atom], adds: Collection[Atom]) -> "FactSet":
        """The facts without `ends` and with `adds`. An atom in both is kept."""
        changed = FactSet()
        changed._extents = self._extents.copy()
        touched: dict[str, tuple[list[Atom], list[Atom]]] = {}
        for atom in ends:
            if atom not in adds:
                touched.setdefault(atom.name, ([], []))[0].append(atom)
        for atom in adds:
            touched.setdefault(atom.name, ([], []))[1].append(atom)
        for name, (lost, gained) in touched.items():
            changed._extents[name] = self._extent(name).after(lost, gained)
        return changed

    def named(self, name: str) -> Collection[Atom]:
        """All atoms of a predicate."""
        return self._extent(name).atoms

    def matching(self, pattern: Atom) -> Collection[Atom]:
        """A superset of the atoms that match a pattern: those that share one of its ground
        arguments.
        """
        extent = self._extent(pattern.name)
        if len(extent.atoms) <= SMALL_EXTENT:
            return extent.atoms
        best: Collection[Atom] = extent.atoms
        for position, argument in enumerate(pattern.arguments):
            if is_ground(argument):
                candidates = extent.where(position, argument)
                if len(candidates) <= SMALL_EXTENT:
                    return candidates
                best = candidates if len(candidates) < len(best) else best
        return best

    def any_match(self, pattern: Atom) -> bool:
        """Whether some atom matches the pattern, in which `_` and variables stand for anything."""
        if is_ground(pattern):
            return pattern in self
        return any(match_term(pattern, fact, {}) is not None for fact in self.matching(pattern))

    def has_type(self, term: Term, type_: str) -> bool:
        """Whether a ground term is a member of a type."""
        if type_ in NUMERIC_TYPES:
            return isinstance(term, Number)
        if type_ == "text":
            return isinstance(term, Text)
        return type_ == OBJECT_TYPE or Function(type_, (term,)) in self


class LayeredFacts(FactSet):
    """The facts of a state, and below them those of predicates of which the state has none."""

    __slots__ = ("_above", "_below")

    def __init__(self, above: FactSet, below: FactSet) -> None:
        super().__init__()
        self._above, self._below = above, below

    def __contains__(self, atom: Atom) -> bool:
        return atom in self._above or atom in self._below

    def _extent(self, name: str) -> PredicateExtent:
        extent = self._above._extent(name)
        return extent if extent.atoms else self._below._extent(name)


class GivenFacts(FactSet):
    """Facts that someone else has evaluated.

    Each predicate is read when it is first asked for; nothing is changed.
    """

    __slots__ = ("_asked", "_holds", "_read", "_told")

    def __init__(
        self, read: Callable[[str], Iterable[Atom]], holds: Callable[[Atom], bool]
    ) -> None:
        """Facts that `read` gives for a predicate, and that `holds` tells one by one."""
        super().__init__()
        self._read, self._holds = read, holds
        self._asked: dict[str, int] = {}
        self._told: dict[Atom, bool] = {}

    def __contains__(self, atom: Atom) -> bool:
        """Whether an atom is among the facts.

        The first questions do not read its predicate, which may be large.
        """
        extent = self._extents.get(atom.name)
        if extent is not None:
            return atom in extent.atoms
        answer = self._told.get(atom)
        return answer if answer is not None else self._tell(atom)

    def _tell(self, atom: Atom) -> bool:
        asked = self._asked[atom.name] = self._asked.get(atom.name, 0) + 1
        if asked > MAX_SINGLE_LOOKUPS:
            return atom in self._extent(atom.name).atoms
        answer = self._told[atom] = self._holds(atom)
        return answer

    def _extent(self, name: str) -> PredicateExtent:
        if name not in self._extents:
            self._extents[name] = PredicateExtent(dict.fromkeys(self._read(name)))
        return self._extents[name]


Bindings = Mapping[Variable, Term]


def solve_body(body: Body, facts: FactSet, bindings: Bindings) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`; negated literals mean absence."""
    return _solve_parts([substitute_part(part, bindings) for part in body], facts, dict(bindings))


def _solve_parts(
    parts: list[BodyPart], facts: FactSet, bindings: dict[Variable, Term]
) -> Iterator[dict[Variable, Term]]:
    """The same, for parts in which the bound variables are already replaced."""
    waiting = []
    for part in parts:
        truth = _part_truth(part, facts)
        if truth is None:
            waiting.append(part)
        elif not truth:
            return
    if not waiting:
        yield bindings
        return
    chosen = waiting.pop(_cheapest_part(waiting, facts) if len(waiting) > 1 else 0)
    for new in _part_bindings(chosen, facts):
        rest = [substitute_part(part, new) for part in waiting] if new else waiting
        yield from _solve_parts(rest, facts, {**bindings, **new})


def _part_truth(part: BodyPart, facts: FactSet) -> bool | None:
    """Whether a part holds; None while it has open variables."""
    match part:
        case Literal(atom, positive):
            return (atom in facts) == positive if is_ground(atom) else None
        case Comparison(left, relation, right):
            return (
                compare_terms(left, relation, right)
                if is_ground(left) and is_ground(right)
                else None
            )
        case StateAggregate():
            return None if part.outer else next(_aggregate_bindings(part, facts), None) is not None
        case Aggregate():
            raise ValueError(f"aggregates must be evaluated before this: {part}")


def is_satisfiable(body: Body, facts: FactSet, bindings: Bindings) -> bool:
    """Whether a body has a binding. Tests come first: most bodies have nothing else."""
    waiting = []
    for part in body:
        bound = substitute_part(part, bindings)
        truth = _part_truth(bound, facts)
        if truth is None:
            waiting.append(bound)
        elif not truth:
            return False
    return not waiting or next(_solve_parts(waiting, facts, {}), None) is not None


def _cheapest_part(parts: list[BodyPart], facts: FactSet) -> int:
    costs = [_estimate_bindings(part, facts) for part in parts]
    return costs.index(min(costs))


def _estimate_bindings(part: BodyPart, facts: FactSet) -> float:
    """An estimate of how many bindings a part with open variables yields."""
    match part:
        case Comparison(left, relation, right):
            return 0 if relation == "=" and _binds_variables(left, right) else float("inf")
        case Literal(atom, positive):
            return len(facts.matching(atom)) if positive else 1e9
        case StateAggregate(outer=outer):
            return 1e10 if len(outer) == 1 else float("inf")
        case _:
            return float("inf")


def _part_bindings(part: BodyPart, facts: FactSet) -> Iterator[Bindings]:
    """The bindings of a part's open variables that make it true."""
    match part:
        case Literal(atom, True):
            matches = (match_term(atom, fact, {}) for fact in facts.matching(atom))
            yield from (match_bindings for match_bindings in matches if match_bindings is not None)
        case Literal(atom):
            if not any(match_term(atom, fact, {}) is not None for fact in facts.matching(atom)):
                yield {}
        case Comparison():
            yield from _comparison_bindings(part)
        case StateAggregate():
            yield from _aggregate_bindings(part, facts)
        case _:
            return


def _aggregate_bindings(part: StateAggregate, facts: FactSet) -> Iterator[Bindings]:
    """The value of the variable that takes that of an aggregate, or nothing to bind, if the
    aggregate is true.
    """
    tuples = {
        tuple(evaluate_term(substitute_term(term, solution)) for term in element.terms)
        for element in part.elements
        for solution in solve_body(element.body, facts, {})
    }
    value = aggregate_key(part.function, tuples)
    term = term_of(value, tuples)
    bindings = {part.outer[0]: term} if part.outer and term is not None else {}
    sides = [
        (relation, evaluate_term(substitute_term(side, bindings))) for relation, side in part.guards
    ]
    if all(side is not None and is_ground(side) for _, side in sides):
        true = all(
            keys_relate(relation, value, order_key(side))
            for relation, side in sides
            if side is not None
        )
        if true is part.positive:
            yield bindings


def _binds_variables(left: Term, right: Term) -> bool:
    """Whether an equation gives values to the variables of one side.

    The other side must have a value, and the side with the variables must not be arithmetic.
    """
    left_ground, right_ground = is_ground(left), is_ground(right)
    return (left_ground or right_ground) and not isinstance(
        right if left_ground else left, Operation
    )


def _comparison_bindings(part: Comparison) -> Iterator[Bindings]:
    if part.relation != "=" or not _binds_variables(part.left, part.right):
        return
    pattern, ground = (part.right, part.left) if is_ground(part.left) else (part.left, part.right)
    value = evaluate_term(ground)
    extended = match_term(pattern, value, {}) if value is not None else None
    if extended is not None:
        yield extended
