"""Features: necessary conditions that are cheap to test on a query before any MACROP is matched.

Many MACROPs share a feature. It is one precondition, constraint or type of a MACROP together with one of its
goals, or with none. A goal of the query binds the variables of that goal; all other variables may be anything
of their types. Each goal of a MACROP serves one goal of the query. So if `n` goals of a MACROP have a
feature, `n` goals of the query must have it. A feature is stored as a text; equal features have equal texts.
"""

import functools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.macros.lookup.matching import match_open
from cellwright.engine.stages.macros.lookup.query import Query
from cellwright.kb.model.conditions import Literal, Parameter
from cellwright.kb.model.macro import Macrop
from cellwright.kb.store.notation import Requirement, read_literal
from cellwright.kb.terms import Function, Term, Variable, match, substitute_atom, variables

GOALS = 1 << 14  # goals whose features are remembered


@dataclass(frozen=True, slots=True)
class LookupFeature:
    """The condition that `wanted` holds for a goal that fits `goal`.

    `wanted` is an atom of the state or of the statics. If it is None, the goal only has to fit. `shape` is
    `goal` as a text, and `own` are the variables of `goal` that occur in `wanted`.
    """

    kind: str  # goal, state, static
    goal: Literal | None
    wanted: Literal | None
    types: tuple[Parameter, ...]
    shape: str
    own: tuple[Variable, ...]


@dataclass(frozen=True, slots=True)
class _Demand:
    """A literal that a MACROP demands of the state or of the statics, with its variables in order."""

    kind: str
    atom: Function
    variables: tuple[Variable, ...]


def requirements(macrop: Macrop) -> tuple[Requirement, ...]:
    """The features of a MACROP, and how many goals must have each of them.

    The order is the same every time.
    """
    found: Counter[str] = Counter()
    asked = [*macrop.goals, *(Literal(stage) for chain in macrop.chains for stage in chain.stages)]
    parts = list(_parts(macrop))
    types: dict[Variable, list[str]] = {}
    for each in macrop.types:
        types.setdefault(each.variable, []).append(each.type)
    for goal in asked:
        own = {v: f"V{number}" for number, v in enumerate(dict.fromkeys(variables(goal.atom)))}
        shape = ("" if goal.positive else "not ") + _said(goal.atom, own)
        touching = [part for part in parts if not own.keys().isdisjoint(part.variables)]
        features = (_feature(shape, part, own, types) for part in touching)
        found.update(dict.fromkeys((f"goal\n{shape}", *features), 1))
    for part in parts:
        if part.kind == "state":
            found[_feature("", part, {}, types)] = 1
    return tuple(found.items())


def _parts(macrop: Macrop) -> Iterator[_Demand]:
    demanded = [("state", each.atom) for each in macrop.preconditions if each.positive]
    demanded += [("static", p.atom) for p in macrop.constraints if isinstance(p, Literal) and p.positive]
    demanded += [("static", Function(p.type, (p.variable,))) for p in macrop.types]
    for kind, atom in demanded:
        yield _Demand(kind, atom, tuple(dict.fromkeys(variables(atom))))


def _said(term: Term, names: dict[Variable, str]) -> str:
    """The text of a term, with other names for its variables."""
    if isinstance(term, Variable):
        return names[term]
    if isinstance(term, Function) and term.arguments:
        return f"{term.name}({', '.join([_said(argument, names) for argument in term.arguments])})"
    return str(term)


def _feature(goal: str, part: _Demand, own: dict[Variable, str], types: dict[Variable, list[str]]) -> str:
    open_ = [variable for variable in part.variables if variable not in own]
    names = {**own, **{variable: f"W{number}" for number, variable in enumerate(open_)}}
    kept = [f"{names[v]} {type_}" for v in open_ for type_ in types.get(v, ())]
    return "\n".join((part.kind, goal, _said(part.atom, names), *kept))


@functools.lru_cache(maxsize=1 << 16)
def feature(text: str) -> LookupFeature:
    """The feature that a text describes."""
    kind, shape, *more = text.split("\n")
    goal = read_literal(shape) if shape else None
    wanted = read_literal(more[0]) if more else None
    pairs = (each.split(" ") for each in more[1:])
    types = tuple(Parameter(Variable(name), type_) for name, type_ in pairs)
    asked = set(variables(goal.atom)) if goal is not None else set()
    stands = dict.fromkeys(variables(wanted.atom)) if wanted is not None else {}
    return LookupFeature(kind, goal, wanted, types, shape, tuple(v for v in stands if v in asked))


Bound = dict[Variable, Term]


@dataclass(frozen=True, slots=True)
class Profile:
    """What is known so far about a goal in a world.

    `bindings` has its bindings by shape, None for a shape that it does not fit. `features` says which
    features over statics it has.
    """

    goal: Literal
    bindings: dict[str, Bound | None] = field(default_factory=dict)
    features: dict[str, bool] = field(default_factory=dict)

    def fitting(self, known: LookupFeature) -> Bound | None:
        """The values that the goal gives to the variables of a feature's goal; None if it does not fit."""
        if known.shape not in self.bindings:
            self.bindings[known.shape] = self._fitting(known.goal)
        return self.bindings[known.shape]

    def _fitting(self, shape: Literal | None) -> Bound | None:
        if shape is None or shape.positive != self.goal.positive:
            return None
        found = match_open(shape.atom, self.goal.atom, {})
        return dict(found) if found is not None else None


class Profiles:
    """The profiles of goals in each world. They are kept because similar queries need the same ones again."""

    def __init__(self) -> None:
        self._worlds: WeakKeyDictionary[CellDomain, dict[Literal, Profile]] = WeakKeyDictionary()

    def of(self, world: CellDomain, goal: Literal) -> Profile:
        """The profile of a goal, to which the caller adds."""
        known = self._worlds.setdefault(world, {})
        if len(known) > GOALS:
            known.clear()
        if goal not in known:
            known[goal] = Profile(goal)
        return known[goal]


class Observed:
    """Counts the goals of a query that have a feature."""

    def __init__(self, asked: Query, profiles: Profiles) -> None:
        self._asked = asked
        pool = [*asked.goals, *(Literal(stage) for chain in asked.chains for stage in chain.stages)]
        self._pool = [profiles.of(asked.world, goal) for goal in pool]

    def count(self, text: str) -> int:
        """The number of goals that have a feature. A feature without a goal counts as 1 or 0."""
        known = feature(text)
        if known.goal is None:
            return int(self._found(known, {}))
        return self._in_state(known) if known.kind == "state" else self._in_statics(text, known)

    def _in_statics(self, text: str, known: LookupFeature) -> int:
        count = 0
        for profile in self._pool:
            found = profile.features.get(text)
            if found is None:
                bindings = profile.fitting(known)
                found = bindings is not None and self._found(known, bindings)
                profile.features[text] = found
            count += found
        return count

    def _in_state(self, known: LookupFeature) -> int:
        """The number of goals that have a feature over the state.

        Goals with equal bindings are tested once.
        """
        seen: dict[tuple[Term | None, ...], bool] = {}
        count = 0
        for profile in self._pool:
            bindings = profile.fitting(known)
            if bindings is not None:
                key = tuple([bindings.get(variable) for variable in known.own])
                found = seen.get(key)
                if found is None:
                    found = seen[key] = self._found(known, bindings)
                count += found
        return count

    def _found(self, known: LookupFeature, bindings: Bound) -> bool:
        if known.wanted is None:
            return True
        facts = self._asked.facts if known.kind == "state" else self._asked.world.statics
        pattern = substitute_atom(known.wanted.atom, bindings)
        if not known.types:
            return facts.any_match(pattern)
        found = (match(pattern, atom, {}) for atom in facts.matching(pattern))
        return any(self._typed(known.types, each) for each in found if each is not None)

    def _typed(self, types: tuple[Parameter, ...], bindings: Bound) -> bool:
        statics = self._asked.world.statics
        return all(statics.has_type(bindings[p.variable], p.type) for p in types)
