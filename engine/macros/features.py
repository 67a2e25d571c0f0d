"""What can be asked of a query at little cost before a MACROP is matched: necessary conditions that many MACROPs share.

A feature is one precondition, constraint or type, seen from one goal (or from none): its goal's variables are bound by
a goal that is asked for, all others may be anything of their types. As MACROPs serve goals one to one, a feature that
`n` goals of a MACROP have needs `n` goals of the query.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from engine.macros.matching import match_open
from engine.macros.query import Query
from kb.model.conditions import Literal, Parameter
from kb.model.macro import Macrop
from kb.terms import Function, Term, Variable, match, substitute_atom, variables


@dataclass(frozen=True, slots=True)
class Feature:
    """`wanted` of a goal that fits `goal`: a state's atom, a static one, or, without, the goal's own shape."""

    kind: str  # goal, state, static
    goal: Literal | None
    wanted: Literal | None = None
    types: tuple[Parameter, ...] = ()


Requirement = tuple[Feature, int]


@dataclass(frozen=True, slots=True)
class _Part:
    """A literal that a MACROP demands, of a state or of statics, with its variables in order."""

    kind: str
    literal: Literal
    variables: tuple[Variable, ...]


def requirements(macrop: Macrop) -> tuple[Requirement, ...]:
    """Features with the number of goals that must have them, each once, in an order that repeats."""
    found: Counter[Feature] = Counter()
    asked = [*macrop.goals, *(Literal(stage) for chain in macrop.chains for stage in chain.stages)]
    parts = list(_parts(macrop))
    types: dict[Variable, list[str]] = {}
    for each in macrop.types:
        types.setdefault(each.variable, []).append(each.type)
    for goal in asked:
        own = _numbered(dict.fromkeys(variables(goal.atom)), "V")
        shape = Literal(substitute_atom(goal.atom, own), goal.positive)
        touching = [part for part in parts if not own.keys().isdisjoint(part.variables)]
        features = (_feature(shape, part, own, types) for part in touching)
        found.update(list(dict.fromkeys((Feature("goal", shape), *features))))
    for part in parts:
        if part.kind == "state":
            found[_feature(None, part, {}, types)] = 1
    return tuple(found.items())


def _parts(macrop: Macrop) -> Iterator[_Part]:
    demanded = [("state", each) for each in macrop.preconditions if each.positive]
    demanded += [("static", p) for p in macrop.constraints if isinstance(p, Literal) and p.positive]
    demanded += [("static", Literal(Function(p.type, (p.variable,)))) for p in macrop.types]
    for kind, literal in demanded:
        yield _Part(kind, literal, tuple(dict.fromkeys(variables(literal.atom))))


def _numbered(found: Iterable[Variable], letter: str) -> dict[Variable, Variable]:
    return {variable: Variable(f"{letter}{number}") for number, variable in enumerate(found)}


def _feature(
    goal: Literal | None, part: _Part, own: dict[Variable, Variable], types: dict[Variable, list[str]]
) -> Feature:
    open_ = [variable for variable in part.variables if variable not in own]
    names = {**own, **_numbered(open_, "W")}
    kept = tuple(Parameter(names[v], type_) for v in open_ for type_ in types.get(v, ()))
    return Feature(part.kind, goal, Literal(substitute_atom(part.literal.atom, names)), kept)


class Observed:
    """How many goals of a query have each feature, found out when first asked."""

    def __init__(self, asked: Query) -> None:
        self._asked = asked
        self._pool = [*asked.goals, *(Literal(stage) for chain in asked.chains for stage in chain.stages)]
        self._bound: dict[Literal | None, list[dict[Variable, Term]]] = {None: [{}]}
        self._counts: dict[Feature, int] = {}

    def meets(self, requirement: Requirement) -> bool:
        """Whether enough goals have a feature."""
        feature, least = requirement
        count = self._counts.get(feature)
        if count is None:
            count = self._counts[feature] = sum(self._holds(feature, b) for b in self._goals(feature.goal))
        return count >= least

    def _goals(self, shape: Literal | None) -> list[dict[Variable, Term]]:
        """The bindings of a goal's variables by each goal asked for that fits."""
        if shape not in self._bound:
            assert shape is not None
            fitting = [match_open(shape.atom, g.atom, {}) for g in self._pool if g.positive == shape.positive]
            self._bound[shape] = [dict(found) for found in fitting if found is not None]
        return self._bound[shape]

    def _holds(self, feature: Feature, bindings: dict[Variable, Term]) -> bool:
        if feature.wanted is None:
            return True
        facts = self._asked.facts if feature.kind == "state" else self._asked.world.statics
        pattern = substitute_atom(feature.wanted.atom, bindings)
        if not feature.types:
            return facts.any_match(pattern)
        found = (match(pattern, atom, {}) for atom in facts.matching(pattern))
        return any(self._typed(feature.types, each) for each in found if each is not None)

    def _typed(self, types: tuple[Parameter, ...], bindings: dict[Variable, Term]) -> bool:
        statics = self._asked.world.statics
        return all(statics.has_type(bindings[p.variable], p.type) for p in types)
