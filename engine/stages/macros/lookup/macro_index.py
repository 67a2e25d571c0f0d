"""Index of MACROPs by goal signature and by features: cheap tests before any MACROP is matched.

Many MACROPs share a feature. It is one precondition, constraint or type of a MACROP together with
one of its goals, or with none. A goal of the query binds the variables of that goal; all other
variables may be anything of their types. Each goal of a MACROP serves one goal of the query. So if
`n` goals of a MACROP have a feature, `n` goals of the query must have it. A feature is stored as a
text; equal features have equal texts.
"""

import functools
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from weakref import WeakKeyDictionary

from cellwright.engine.stages.lifted.cell_domain import CellDomain
from cellwright.engine.stages.macros.lookup.macro_matching import MatchingOrder, match_open
from cellwright.engine.stages.macros.lookup.macro_query import (
    MacroQuery,
    signature_asked,
    signature_of,
)
from cellwright.kb.model.conditions import Literal, Parameter
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.store.term_notation import Requirement, read_literal
from cellwright.kb.terms import (
    Function,
    Term,
    Variable,
    match_term,
    substitute_atom,
    term_variables,
)

MAX_REMEMBERED_PROFILES = 1 << 14  # goals whose features are remembered


@dataclass(frozen=True, slots=True)
class LookupFeature:
    """The condition that `wanted` holds for a goal that fits `goal`.

    `wanted` is an atom of the state or of the statics. If it is None, the goal only has to fit.
    `shape` is `goal` as a text, and `own` are the variables of `goal` that occur in `wanted`.
    """

    kind: str  # goal, state, static
    goal: Literal | None
    wanted: Literal | None
    types: tuple[Parameter, ...]
    shape: str
    own: tuple[Variable, ...]


@dataclass(frozen=True, slots=True)
class _Demand:
    """A literal that a MACROP demands of the state or of the statics, with its variables in
    order.
    """

    kind: str
    atom: Function
    variables: tuple[Variable, ...]


def macro_requirements(macrop: Macrop) -> tuple[Requirement, ...]:
    """The features of a MACROP, and how many goals must have each of them.

    The order is the same every time.
    """
    counts: Counter[str] = Counter()
    asked = [*macrop.goals, *(Literal(stage) for chain in macrop.chains for stage in chain.stages)]
    parts = list(_demanded_parts(macrop))
    types: dict[Variable, list[str]] = {}
    for type_test in macrop.types:
        types.setdefault(type_test.variable, []).append(type_test.type)
    for goal in asked:
        own = {v: f"V{number}" for number, v in enumerate(dict.fromkeys(term_variables(goal.atom)))}
        shape = ("" if goal.positive else "not ") + _term_text(goal.atom, own)
        touching = [part for part in parts if not own.keys().isdisjoint(part.variables)]
        features = (_feature_text(shape, part, own, types) for part in touching)
        counts.update(dict.fromkeys((f"goal\n{shape}", *features), 1))
    for part in parts:
        if part.kind == "state":
            counts[_feature_text("", part, {}, types)] = 1
    return tuple(counts.items())


def _demanded_parts(macrop: Macrop) -> Iterator[_Demand]:
    demanded = [
        ("state", precondition.atom)
        for precondition in macrop.preconditions
        if precondition.positive
    ]
    demanded += [
        ("static", p.atom) for p in macrop.constraints if isinstance(p, Literal) and p.positive
    ]
    demanded += [("static", Function(p.type, (p.variable,))) for p in macrop.types]
    for kind, atom in demanded:
        yield _Demand(kind, atom, tuple(dict.fromkeys(term_variables(atom))))


def _term_text(term: Term, names: dict[Variable, str]) -> str:
    """The text of a term, with other names for its variables."""
    if isinstance(term, Variable):
        return names[term]
    if isinstance(term, Function) and term.arguments:
        return f"{term.name}({', '.join([_term_text(argument, names) for argument in term.arguments])})"
    return str(term)


def _feature_text(
    goal: str, part: _Demand, own: dict[Variable, str], types: dict[Variable, list[str]]
) -> str:
    open_ = [variable for variable in part.variables if variable not in own]
    names = {**own, **{variable: f"W{number}" for number, variable in enumerate(open_)}}
    type_texts = [f"{names[v]} {type_}" for v in open_ for type_ in types.get(v, ())]
    return "\n".join((part.kind, goal, _term_text(part.atom, names), *type_texts))


@functools.lru_cache(maxsize=1 << 16)
def parse_feature(text: str) -> LookupFeature:
    """The feature that a text describes."""
    kind, shape, *more = text.split("\n")
    goal = read_literal(shape) if shape else None
    literal = read_literal(more[0]) if more else None
    pairs = (pair_text.split(" ") for pair_text in more[1:])
    types = tuple(Parameter(Variable(name), type_) for name, type_ in pairs)
    asked = set(term_variables(goal.atom)) if goal is not None else set()
    stands = dict.fromkeys(term_variables(literal.atom)) if literal is not None else {}
    return LookupFeature(kind, goal, literal, types, shape, tuple(v for v in stands if v in asked))


Bound = dict[Variable, Term]


@dataclass(frozen=True, slots=True)
class GoalProfile:
    """What is known so far about a goal in a world.

    `bindings` has its bindings by shape, None for a shape that it does not fit. `features` says
    which features over statics it has.
    """

    goal: Literal
    bindings: dict[str, Bound | None] = field(default_factory=dict)
    features: dict[str, bool] = field(default_factory=dict)

    def fitting(self, known: LookupFeature) -> Bound | None:
        """The values that the goal gives to the variables of a feature's goal; None if it does
        not fit.
        """
        if known.shape not in self.bindings:
            self.bindings[known.shape] = self._fitting(known.goal)
        return self.bindings[known.shape]

    def _fitting(self, shape: Literal | None) -> Bound | None:
        if shape is None or shape.positive != self.goal.positive:
            return None
        bindings = match_open(shape.atom, self.goal.atom, {})
        return dict(bindings) if bindings is not None else None


class GoalProfiles:
    """The profiles of goals in each world.

    They are kept because similar queries need the same ones again.
    """

    def __init__(self) -> None:
        self._worlds: WeakKeyDictionary[CellDomain, dict[Literal, GoalProfile]] = (
            WeakKeyDictionary()
        )

    def of(self, world: CellDomain, goal: Literal) -> GoalProfile:
        """The profile of a goal, to which the caller adds."""
        profiles = self._worlds.setdefault(world, {})
        if len(profiles) > MAX_REMEMBERED_PROFILES:
            profiles.clear()
        if goal not in profiles:
            profiles[goal] = GoalProfile(goal)
        return profiles[goal]


class FeatureCounter:
    """Counts the goals of a query that have a feature."""

    def __init__(self, asked: MacroQuery, profiles: GoalProfiles) -> None:
        self._asked = asked
        pool = [*asked.goals, *(Literal(stage) for chain in asked.chains for stage in chain.stages)]
        self._pool = [profiles.of(asked.world, goal) for goal in pool]

    def count(self, text: str) -> int:
        """The number of goals that have a feature. A feature without a goal counts as 1 or 0."""
        lookup_feature = parse_feature(text)
        if lookup_feature.goal is None:
            return int(self._found(lookup_feature, {}))
        return (
            self._in_state(lookup_feature)
            if lookup_feature.kind == "state"
            else self._in_statics(text, lookup_feature)
        )

    def _in_statics(self, text: str, known: LookupFeature) -> int:
        count = 0
        for profile in self._pool:
            has_feature = profile.features.get(text)
            if has_feature is None:
                bindings = profile.fitting(known)
                has_feature = bindings is not None and self._found(known, bindings)
                profile.features[text] = has_feature
            count += has_feature
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
                has_feature = seen.get(key)
                if has_feature is None:
                    has_feature = seen[key] = self._found(known, bindings)
                count += has_feature
        return count

    def _found(self, known: LookupFeature, bindings: Bound) -> bool:
        if known.wanted is None:
            return True
        facts = self._asked.facts if known.kind == "state" else self._asked.world.statics
        pattern = substitute_atom(known.wanted.atom, bindings)
        if not known.types:
            return facts.any_match(pattern)
        matches = (match_term(pattern, atom, {}) for atom in facts.matching(pattern))
        return any(
            self._typed(known.types, match_bindings)
            for match_bindings in matches
            if match_bindings is not None
        )

    def _typed(self, types: tuple[Parameter, ...], bindings: Bound) -> bool:
        statics = self._asked.world.statics
        return all(statics.has_type(bindings[p.variable], p.type) for p in types)


UNKNOWN_COST = 1 << 62

Rank = tuple[int, int, str, str]


@dataclass(frozen=True)
class IndexEntry:
    """A MACROP of the index under the key of its library.

    Entries are tried in the order of `rank`, cheap ones first. This order is the same every time.
    """

    key: Hashable
    rank: Rank
    read: Callable[[], Macrop | None] = field(compare=False)

    @property
    def cost(self) -> int | None:
        """What every instance costs; None if that depends on the binding."""
        return None if self.rank[0] == UNKNOWN_COST else self.rank[0]

    @cached_property
    def macrop(self) -> Macrop | None:
        """The MACROP, read at the first use; None if it was removed since then."""
        return self.read()

    @cached_property
    def program(self) -> MatchingOrder | None:
        """The order in which its parts are matched."""
        return MatchingOrder(self.macrop) if self.macrop is not None else None


def macro_rank(key: Hashable, name: str, cost: int | None, steps: int) -> Rank:
    """The sort key of a MACROP among those that fit: cost, then number of steps, then header
    and key.
    """
    return UNKNOWN_COST if cost is None else cost, steps, name, str(key)


class _Shelf:
    """The MACROPs of one signature, one bit each."""

    def __init__(self) -> None:
        self.entries: list[IndexEntry | None] = []
        self.present = 0
        self.requiring: dict[str, dict[int, int]] = {}
        self.order: list[str] = []

    def add(self, entry: IndexEntry, required: Iterable[Requirement]) -> int:
        place = len(self.entries)
        bit = 1 << place
        self.entries.append(entry)
        self.present |= bit
        for feature, least in required:
            sets = self.requiring.get(feature)
            if sets is None:
                sets = self.requiring[feature] = {}
                self.order.clear()
            sets[least] = sets.get(least, 0) | bit
        return place

    def remove(self, place: int) -> None:
        self.entries[place] = None
        self.present &= ~(1 << place)

    def fitting(self, observed: FeatureCounter) -> list[IndexEntry]:
        """The entries whose requirements are met.

        A requirement that no remaining entry has is skipped.
        """
        if not self.order:
            # features without a goal come first: each costs a single test
            self.order = sorted(self.requiring, key=lambda text: not text.startswith("state\n\n"))
        remaining = self.present
        for text in self.order:
            sets = self.requiring[text]
            if any(remaining & those for those in sets.values()):
                count = observed.count(text)
                for least, those in sets.items():
                    if count < least:
                        remaining &= ~those
        return [
            entry for place in _single_bits(remaining) if (entry := self.entries[place]) is not None
        ]


def _single_bits(number: int) -> Iterable[int]:
    while number:
        lowest = number & -number
        yield lowest.bit_length() - 1
        number ^= lowest


class MacroIndex:
    """The MACROPs that lookup can use. The caller chooses the keys."""

    def __init__(self) -> None:
        self._shelves: dict[str, _Shelf] = {}
        self._places: dict[Hashable, tuple[_Shelf, int]] = {}
        self._profiles = GoalProfiles()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._places

    def add(self, key: Hashable, macrop: Macrop) -> None:
        """Add a MACROP. It replaces one with the same key."""
        order = macro_rank(key, str(macrop.name), macrop.cost, len(macrop.steps))
        self.put(
            signature_of(macrop), IndexEntry(key, order, lambda: macrop), macro_requirements(macrop)
        )

    def put(self, signature: str, entry: IndexEntry, required: Iterable[Requirement]) -> None:
        """Add an entry with its requirements. Its MACROP need not have been read yet."""
        self.remove(entry.key)
        shelf = self._shelves.setdefault(signature, _Shelf())
        self._places[entry.key] = shelf, shelf.add(entry, required)

    def remove(self, key: Hashable) -> None:
        """Remove a MACROP, if the index has it."""
        location = self._places.pop(key, None)
        if location is not None:
            shelf, place = location
            shelf.remove(place)

    def has(self, signature: str) -> bool:
        """Whether there are MACROPs for goals of a signature."""
        shelf = self._shelves.get(signature)
        return shelf is not None and any(shelf.entries)

    def candidates(self, asked: MacroQuery) -> list[IndexEntry]:
        """The MACROPs for the query's goals that have all requirements met, the cheapest first."""
        shelf = self._shelves.get(signature_asked(asked))
        if shelf is None:
            return []
        return sorted(
            shelf.fitting(FeatureCounter(asked, self._profiles)), key=lambda entry: entry.rank
        )
