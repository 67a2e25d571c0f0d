"""Decision diagrams of aggregates: from which tuples are in a set follows, by rules, whether its value fits.

A diagram looks at one group of tuples after another; at most one tuple of a group is in the set. A node stands for a place in
this order and the value so far, so equal sums share one node (Eén & Sörensson 2006). Where a larger value fits whenever a
smaller one does, or the reverse, nodes ask only for what is needed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.task import Bits
from cellwright.engine.stages.grounding.aggregates import COLLECTED, Fitting
from cellwright.engine.stages.grounding.derived import Rules
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.arithmetic import evaluate, order_key
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.terms import Function, Number, Term, Variable, match, substitute

Key = tuple[object, ...]
Body = tuple[int, ...]
LEAST: Key = (-1,)  # before all terms: the #max of nothing
GREATEST: Key = (9,)  # behind all terms: the #min of nothing
MOST = 50_000  # nodes of one aggregate
RISING, FALLING = (">", ">="), ("<", "<=")
NEGATION = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


@dataclass(frozen=True, slots=True)
class Test:
    """Whether the value of an aggregate fits: all comparisons hold, or, if it is not `positive`, one does not."""

    guards: tuple[tuple[str, Key], ...]
    positive: bool

    def verdict(self, low: Key, high: Key) -> bool | None:
        """Whether every value from `low` to `high` fits, or none does; None if that is open."""
        found = [_compared(relation, low, high, bound) for relation, bound in self.guards]
        known = False if False in found else None if None in found else True
        return known if self.positive or known is None else not known

    @property
    def direction(self) -> int:
        """1 if every value above one that fits does, -1 if every one below does, else 0."""
        relations = {relation for relation, _ in self.guards}
        sign = 1 if relations <= set(RISING) else -1 if relations <= set(FALLING) else 0
        return sign if self.positive else -sign


def _compared(relation: str, low: Key, high: Key, bound: Key) -> bool | None:
    """What is true of a comparison for all values from `low` to `high`."""
    match relation:
        case "<":
            return True if high < bound else False if low >= bound else None
        case "<=":
            return True if high <= bound else False if low > bound else None
        case "=":
            return True if low == high == bound else None if low <= bound <= high else False
        case _:
            found = _compared(NEGATION[relation], low, high, bound)
            return None if found is None else not found


@dataclass(frozen=True, slots=True)
class Choice:
    """One tuple of a group: the signed number of its atom, and its weight."""

    atom: int
    weight: Key


def decide(fittings: Sequence[Fitting], universe: Universe, denied: Sequence[Bits], rules: Rules) -> None:
    """Add to `rules` those of all atoms that stand for aggregates. `denied` has what each fluent denies.

    Raises `InvalidInput` where an aggregate has too many values.
    """
    members: dict[tuple[str, tuple[Term, ...]], list[tuple[Function, int]]] = {}
    for atom, number in universe.index.items():
        if atom.name.startswith(COLLECTED):
            members.setdefault((atom.name, atom.arguments[:-1]), []).append((atom, number))
    heads = {each.head.name: each for each in fittings}
    for atom, number in list(universe.index.items()):
        if (fitting := heads.get(atom.name)) is None:
            continue
        bindings = match(fitting.head, atom, {}) or {}
        if (test := _test(fitting, bindings)) is not None:
            own = tuple(substitute(each, bindings) for each in fitting.collected.arguments[:-1])
            choices = _choices(fitting, members.get((fitting.collected.name, own), []))
            groups = _groups(list(choices), denied, rules)
            try:
                found = _Diagram(fitting.aggregate.function, groups, test, universe, rules).bodies()
            except OverflowError:
                message = f"on the way, #{fitting.aggregate.function} has more than {MOST} different values"
                hint = "count fewer things, or weights in larger units"
                raise InvalidInput([Diagnostic(fitting.where, "K007", message, hint)]) from None
            rules.setdefault(number, []).extend(found)


def _test(fitting: Fitting, bindings: Mapping[Variable, Term]) -> Test | None:
    """The comparisons with their values; None if one has none, so that nothing fits."""
    found = []
    for relation, term in fitting.aggregate.guards:
        value = evaluate(substitute(term, bindings))
        if value is None:
            return None
        found.append((relation, order_key(value)))
    return Test(tuple(found), fitting.aggregate.positive)


def _choices(fitting: Fitting, members: list[tuple[Function, int]]) -> Iterator[Choice]:
    """The tuples that count, with their weights; #sum passes over what is no number, as clingo does."""
    for atom, number in members:
        held = atom.arguments[-1]
        assert isinstance(held, Function)
        first = held.arguments[0] if held.arguments else Number(0)
        if fitting.aggregate.function == "count":
            yield Choice(number, (0, 1))
        elif fitting.aggregate.function != "sum" or (isinstance(first, Number) and first.value):
            yield Choice(number, order_key(first))


def _groups(choices: list[Choice], denied: Sequence[Bits], rules: Rules) -> list[list[Choice]]:
    """The tuples in groups of which at most one is in the set, because its fluents deny those of the others."""
    groups: list[list[Choice]] = []
    fluents = {each.atom: _fluents(each.atom, rules, len(denied)) for each in choices}
    for each in choices:
        for group in groups:
            if all(_exclude(fluents[each.atom], fluents[other.atom], denied) for other in group):
                group.append(each)
                break
        else:
            groups.append([each])
    return groups


def _fluents(atom: int, rules: Rules, size: int) -> list[list[int]]:
    """For each rule of a collected atom the fluents that it needs."""
    return [[each for each in body if 0 <= each < size] for body in rules.get(atom, [])]


def _exclude(one: list[list[int]], other: list[list[int]], denied: Sequence[Bits]) -> bool:
    return all(
        any(denied[a] >> b & 1 and denied[b] >> a & 1 for a in first for b in second)
        for first in one
        for second in other
    )


class _Diagram:
    """The rules of one aggregate over groups of tuples."""

    def __init__(
        self, function: str, groups: list[list[Choice]], test: Test, universe: Universe, rules: Rules
    ) -> None:
        self.groups, self.test, self.universe, self.rules = groups, test, universe, rules
        self.join: Callable[[Key, Key], Key] = _JOINED[function]
        self.start = _STARTS[function]
        self.function = function
        self.low, self.high = self._ranges()
        self.known: dict[tuple[Body, ...], int] = {}

    def _ranges(self) -> tuple[list[Key], list[Key]]:
        """For each place the least and the greatest value of all groups from there on."""
        low, high = [self.start], [self.start]
        for group in reversed(self.groups):
            options = [each.weight for each in group]
            low.append(min(low[-1], *(self.join(low[-1], each) for each in options)))
            high.append(max(high[-1], *(self.join(high[-1], each) for each in options)))
        return low[::-1], high[::-1]

    def _verdict(self, place: int, value: Key) -> bool | None:
        return self.test.verdict(self.join(value, self.low[place]), self.join(value, self.high[place]))

    def bodies(self) -> list[Body]:
        """The bodies of the rules that make the aggregate fit."""
        levels = [{self.start}]
        for place, group in enumerate(self.groups):
            open_ = [value for value in levels[-1] if self._verdict(place, value) is None]
            found = {self.join(value, each.weight) for value in open_ for each in group}
            levels.append(found.union(open_))
            if sum(map(len, levels)) > MOST:
                raise OverflowError
        after: dict[Key, list[Body]] = {}
        for place in reversed(range(len(levels))):
            named = {value: self._named(bodies) for value, bodies in after.items()}
            after = {value: self._at(place, value, named) for value in sorted(levels[place], key=repr)}
        return after[self.start]

    def _at(self, place: int, value: Key, after: Mapping[Key, Body | None]) -> list[Body]:
        """The bodies for a value at a place, from what follows at the next place."""
        known = self._verdict(place, value)
        if known is not None:
            return [()] if known else []
        group, direction = self.groups[place], self.test.direction
        found: list[Body] = []
        for each in group:
            then = after[self.join(value, each.weight)]
            if then is not None and direction * self._side(each) >= 0:
                found.append((each.atom, *then))
            if then is not None and direction and direction * self._side(each) < 0:
                worse = (o.atom for o in group if direction * self._rank(o, each) < 0)
                found.append((*(~atom for atom in worse), *then))
        then = after[value]
        if then is not None:
            excluded = (o.atom for o in group if not direction or direction * self._side(o) < 0)
            found.append((*(~atom for atom in excluded), *then))
        if () in found:
            return [()]
        return list(dict.fromkeys(found))

    def _side(self, choice: Choice) -> int:
        """1 if a tuple makes the value larger than without it, else -1."""
        if self.function in ("min", "max"):
            return 1 if self.function == "max" else -1
        return 1 if choice.weight > (0, 0) else -1

    def _rank(self, one: Choice, other: Choice) -> int:
        return (one.weight > other.weight) - (one.weight < other.weight)

    def _named(self, bodies: list[Body]) -> Body | None:
        """What stands for some bodies in the bodies before: nothing, a single literal, or a new derived atom; None if none."""
        if not bodies:
            return None
        if len(bodies) == 1 and len(bodies[0]) <= 1:
            return bodies[0]
        key = tuple(bodies)
        if key not in self.known:
            number = self.universe.derive(Function("_value", (Number(len(self.universe.derived)),)))
            self.known[key] = number
            self.rules[number] = list(bodies)
        return (self.known[key],)


def _sum(one: Key, other: Key) -> Key:
    assert isinstance(one[1], int)
    assert isinstance(other[1], int)
    return (0, one[1] + other[1])


_JOINED: Mapping[str, Callable[[Key, Key], Key]] = {"count": _sum, "sum": _sum, "min": min, "max": max}
_STARTS: Mapping[str, Key] = {"count": (0, 0), "sum": (0, 0), "min": GREATEST, "max": LEAST}
