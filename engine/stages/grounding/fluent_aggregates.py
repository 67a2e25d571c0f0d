"""Aggregates over fluents, replaced by derived predicates and decided by decision diagrams.

A rule with the aggregate A becomes a rule with the literal `_fits_n(outer variables)`. The atoms
`_collected_n(outer variables, tuple)` are true where a tuple belongs to the set. Which of them make
`_fits_n` true, `cellwright.engine.stages.grounding.fluent_aggregates` says when all atoms have
numbers. Aggregates that give a variable its value get one atom for each value that the set may
have.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.stages.grounding.derived_atoms import Rules
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.kb.arithmetic import evaluate_term, order_key
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Literal,
    StateAggregate,
    part_variables,
)
from cellwright.kb.model.domain_model import OBJECT_TYPE, Domain, Rule
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_term,
    term_variables,
)

TUPLE, COLLECTED, FITS = "_tuple", "_collected_", "_fits_"


@dataclass(frozen=True, slots=True)
class FittingAggregate:
    """The aggregate that the derived predicate of `head` stands for; `collected` is the atom of
    a tuple in its set.
    """

    head: Atom
    collected: Atom
    aggregate: StateAggregate
    where: Source


@dataclass(frozen=True, slots=True)
class ExpandedRules:
    """Rules without aggregates over fluents.

    `reach` say which atoms of `fittings` may become true; they are no definitions.
    """

    rules: tuple[Rule, ...]
    reach: tuple[Rule, ...] = ()
    fittings: tuple[FittingAggregate, ...] = ()


def expand_aggregates(
    rules: Iterable[Rule], domain: Domain, is_dynamic: Callable[[str], bool]
) -> ExpandedRules:
    """The rules without aggregates over fluents, and the predicates that stand for these.

    Raises `InvalidInput`.
    """
    rules_made: list[Rule] = []
    reach: list[Rule] = []
    fittings: list[FittingAggregate] = []
    for rule in rules:
        aggregates = [part for part in rule.body if isinstance(part, StateAggregate)]
        if not aggregates:
            rules_made.append(rule)
            continue
        expansion = _Expansion(rule, domain, is_dynamic)
        for aggregate in _in_order(aggregates, expansion.bound):
            fitting = expansion.replace(aggregate, len(fittings))
            fittings.append(fitting)
            rules_made += expansion.collecting(fitting)
            reach += expansion.reaching(fitting)
            expansion.give(fitting)
        rules_made.append(Rule(rule.head, tuple(expansion.body), rule.where))
    return ExpandedRules(tuple(rules_made), tuple(reach), tuple(fittings))


def _in_order(aggregates: list[StateAggregate], bound: set[Variable]) -> Iterator[StateAggregate]:
    """The aggregates in an order in which each has its outer variables, except for its own
    value, from the ones before.
    """
    waiting, bound_so_far = list(aggregates), set(bound)
    while waiting:
        ready = (
            aggregate
            for aggregate in waiting
            if bound_so_far.issuperset(
                set(aggregate.outer) - {_assigned_variable(aggregate, bound_so_far)}
            )
        )
        chosen = next(ready, waiting[0])
        waiting.remove(chosen)
        bound_so_far.update(chosen.outer)
        yield chosen


def _assigned_variable(aggregate: StateAggregate, bound: set[Variable]) -> Variable | None:
    """The variable that takes the value of an aggregate, if there is one."""
    if not aggregate.positive:
        return None
    for relation, term in aggregate.guards:
        if relation == "=" and isinstance(term, Variable) and term not in bound:
            return term
    return None


class _Expansion:
    """One rule whose aggregates are replaced one after another.

    `bound` are the variables that have values so far.
    """

    def __init__(self, rule: Rule, domain: Domain, is_dynamic: Callable[[str], bool]) -> None:
        self.rule, self.domain, self.is_dynamic = rule, domain, is_dynamic
        self.body: list[BodyPart] = [p for p in rule.body if not isinstance(p, StateAggregate)]
        self.guard: list[BodyPart] = []
        self.bound: set[Variable] = set()
        self._bind()

    def _bind(self) -> None:
        """Note which variables the plain parts bind, and which parts can be tested by then."""
        for part in self.body:
            if isinstance(part, Literal) and part.positive:
                self.bound.update(v for v in term_variables(part.atom) if v != ANYTHING)
        while (
            more := {v for part in self.body for v in _solved_variables(part, self.bound)}
            - self.bound
        ):
            self.bound |= more
        self.guard = [self._reachable(part) for part in self.body if self._is_known(part)]

    def _is_known(self, part: BodyPart) -> bool:
        if isinstance(part, Literal) and not part.positive:
            return not self.is_dynamic(part.atom.name)
        return self.bound.issuperset(v for v in part_variables(part) if v != ANYTHING)

    def _reachable(self, part: BodyPart) -> BodyPart:
        """A condition on what can become true, which is no condition on the state."""
        if isinstance(part, Literal) and self.is_dynamic(part.atom.name):
            return Literal(Function(f"_r_{part.atom.name}", part.atom.arguments))
        return part

    def replace(self, aggregate: StateAggregate, number: int) -> FittingAggregate:
        """The predicates that stand for an aggregate."""
        value = _assigned_variable(aggregate, self.bound)
        inside = {
            v
            for element in aggregate.elements
            for term in element.terms
            for v in term_variables(term)
        }
        inside |= {
            v
            for element in aggregate.elements
            for part in element.body
            for v in part_variables(part)
        }
        own = tuple(v for v in aggregate.outer if v in inside and v != value)
        collected = Function(f"{COLLECTED}{number}", (*own, Variable("_Tuple")))
        return FittingAggregate(
            Function(f"{FITS}{number}", aggregate.outer), collected, aggregate, self.rule.where
        )

    def give(self, fitting: FittingAggregate) -> None:
        """Put the literal for an aggregate into the body. What it binds is bound from now on."""
        self.body.append(Literal(fitting.head))
        self._bind()

    def collecting(self, fitting: FittingAggregate) -> Iterator[Rule]:
        """The rules for the tuples in the set of an aggregate."""
        for element in fitting.aggregate.elements:
            arguments = (*fitting.collected.arguments[:-1], Function(TUPLE, element.terms))
            head, equations = _without_arithmetic(Function(fitting.collected.name, arguments))
            yield Rule(head, (*self.guard, *element.body, *equations), self.rule.where)

    def reaching(self, fitting: FittingAggregate) -> Iterator[Rule]:
        """The rules for the values that an aggregate may have, or for the instances of its test."""
        value = _assigned_variable(fitting.aggregate, self.bound)
        if value is None:
            yield Rule(fitting.head, tuple(self.guard), self.rule.where)
            return
        bodies = [
            (element.terms, self._standing(element.body)) for element in fitting.aggregate.elements
        ]
        if fitting.aggregate.function in ("min", "max"):
            for terms, body in bodies:
                equation = Comparison(value, "=", terms[0])
                yield Rule(fitting.head, (*self.guard, *body, equation), self.rule.where)
            return
        texts = [
            (", ".join(map(str, terms)), terms[0], ", ".join(map(str, body)))
            for terms, body in bodies
        ]
        if fitting.aggregate.function == "count":
            least, most = (
                "0",
                f"#count {{ {'; '.join(f'{text} : {body}' for text, _, body in texts)} }}",
            )
        else:
            least, most = (
                f"#sum {{ "
                f"{'; '.join(f'{text} : {body}, {first} {sign} 0' for text, first, body in texts)} "
                f"}}"
                for sign in "<>"
            )
        counted = f"_Least = {least}, _Most = {most}, {value} = _Least.._Most"
        yield Rule(fitting.head, (*self.guard, Aggregate(counted, (value,))), self.rule.where)

    def _standing(self, body: Iterable[BodyPart]) -> Body:
        """A body over types and statics that is true wherever the body may become true."""
        parts: list[BodyPart] = []
        for part in body:
            if not isinstance(part, Literal) or not self.is_dynamic(part.atom.name):
                parts.append(part)
            elif part.positive:
                types = self.domain.predicates[part.atom.name].arguments
                parts += (
                    Literal(Function(type_, (term,)))
                    for term, type_ in zip(part.atom.arguments, types, strict=True)
                    if type_ != OBJECT_TYPE
                    and self.domain.is_subtype(type_, OBJECT_TYPE)
                    and term != ANYTHING
                )
        self._refuse_unbound(parts, body)
        return tuple(parts)

    def _refuse_unbound(self, parts: list[BodyPart], body: Iterable[BodyPart]) -> None:
        given_variables = {
            v
            for p in parts
            if isinstance(p, Literal) and p.positive
            for v in term_variables(p.atom)
        }
        given_variables |= self.bound
        while (
            more := {v for part in parts for v in _solved_variables(part, given_variables)}
            - given_variables
        ):
            given_variables |= more
        lost = [
            v
            for part in body
            for v in part_variables(part)
            if v not in given_variables and v != ANYTHING
        ]
        if lost:
            message = (
                f"only fluents bind {lost[0]}, so nobody can tell which values this aggregate "
                "may have"
            )
            hint = (
                f"bind {lost[0]} by a static in the braces, or compare the aggregate with a number"
            )
            raise InvalidInput([Diagnostic(self.rule.where, "K202", message, hint)])


def _solved_variables(part: BodyPart, bound: set[Variable]) -> Iterator[Variable]:
    """The variables that an equation binds."""
    if isinstance(part, Comparison) and part.relation == "=":
        for ground_side, open_side in ((part.left, part.right), (part.right, part.left)):
            if isinstance(open_side, Variable | Function) and bound.issuperset(
                term_variables(ground_side)
            ):
                yield from (v for v in term_variables(open_side) if v != ANYTHING)


def _without_arithmetic(atom: Atom) -> tuple[Atom, list[Comparison]]:
    """An atom whose last argument has variables in place of computed values, and what these are."""
    *rest, last = atom.arguments
    assert isinstance(last, Function)
    equations: list[Comparison] = []
    terms: list[Term] = []
    for place, term in enumerate(last.arguments):
        if isinstance(term, Variable | Function) or is_ground(term):
            terms.append(term)
            continue
        terms.append(Variable(f"_Computed{place}"))
        equations.append(Comparison(terms[-1], "=", term))
    return Function(atom.name, (*rest, Function(TUPLE, tuple(terms)))), equations


Key = tuple[object, ...]
DiagramBody = tuple[int, ...]
LOWEST_KEY: Key = (-1,)  # before all terms: the #max of nothing
HIGHEST_KEY: Key = (9,)  # behind all terms: the #min of nothing
MAX_DIAGRAM_NODES = 50_000  # nodes of one aggregate
RISING, FALLING = (">", ">="), ("<", "<=")
NEGATED_RELATIONS = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


@dataclass(frozen=True, slots=True)
class AggregateTest:
    """Whether the value of an aggregate fits: all comparisons hold, or, if it is not
    `positive`, one does not.
    """

    guards: tuple[tuple[str, Key], ...]
    positive: bool

    def verdict(self, low: Key, high: Key) -> bool | None:
        """Whether every value from `low` to `high` fits, or none does; None if that is open."""
        verdicts = [_compare_range(relation, low, high, bound) for relation, bound in self.guards]
        verdict = False if False in verdicts else None if None in verdicts else True
        return verdict if self.positive or verdict is None else not verdict

    @property
    def direction(self) -> int:
        """1 if every value above one that fits does, -1 if every one below does, else 0."""
        relations = {relation for relation, _ in self.guards}
        sign = 1 if relations <= set(RISING) else -1 if relations <= set(FALLING) else 0
        return sign if self.positive else -sign


def _compare_range(relation: str, low: Key, high: Key, bound: Key) -> bool | None:
    """What is true of a comparison for all values from `low` to `high`."""
    match relation:
        case "<":
            return True if high < bound else False if low >= bound else None
        case "<=":
            return True if high <= bound else False if low > bound else None
        case "=":
            return True if low == high == bound else None if low <= bound <= high else False
        case _:
            outcome = _compare_range(NEGATED_RELATIONS[relation], low, high, bound)
            return None if outcome is None else not outcome


@dataclass(frozen=True, slots=True)
class WeightedTuple:
    """One tuple of a group: the signed number of its atom, and its weight."""

    atom: int
    weight: Key


def decide_aggregates(
    fittings: Sequence[FittingAggregate], universe: Universe, denied: Sequence[Bits], rules: Rules
) -> None:
    """Add to `rules` those of all atoms that stand for aggregates. `denied` has what each fluent
    denies.

    Raises `InvalidInput` where an aggregate has too many values.
    """
    members: dict[tuple[str, tuple[Term, ...]], list[tuple[Function, int]]] = {}
    for atom, number in universe.index.items():
        if atom.name.startswith(COLLECTED):
            members.setdefault((atom.name, atom.arguments[:-1]), []).append((atom, number))
    heads = {fitting.head.name: fitting for fitting in fittings}
    for atom, number in list(universe.index.items()):
        if (fitting := heads.get(atom.name)) is None:
            continue
        bindings = match_term(fitting.head, atom, {}) or {}
        if (test := _aggregate_test(fitting, bindings)) is not None:
            own = tuple(
                substitute_term(argument, bindings) for argument in fitting.collected.arguments[:-1]
            )
            choices = _weighted_tuples(fitting, members.get((fitting.collected.name, own), []))
            groups = _exclusive_groups(list(choices), denied, rules)
            try:
                diagram_bodies = _Diagram(
                    fitting.aggregate.function, groups, test, universe, rules
                ).bodies()
            except OverflowError:
                message = (
                    f"on the way, #{fitting.aggregate.function} has more than "
                    f"{MAX_DIAGRAM_NODES} different values"
                )
                hint = "count fewer things, or weights in larger units"
                raise InvalidInput([Diagnostic(fitting.where, "K007", message, hint)]) from None
            rules.setdefault(number, []).extend(diagram_bodies)


def _aggregate_test(
    fitting: FittingAggregate, bindings: Mapping[Variable, Term]
) -> AggregateTest | None:
    """The comparisons with their values; None if one has none, so that nothing fits."""
    guards = []
    for relation, term in fitting.aggregate.guards:
        value = evaluate_term(substitute_term(term, bindings))
        if value is None:
            return None
        guards.append((relation, order_key(value)))
    return AggregateTest(tuple(guards), fitting.aggregate.positive)


def _weighted_tuples(
    fitting: FittingAggregate, members: list[tuple[Function, int]]
) -> Iterator[WeightedTuple]:
    """The tuples that count, with their weights; #sum passes over what is no number, as clingo
    does.
    """
    for atom, number in members:
        last_argument = atom.arguments[-1]
        assert isinstance(last_argument, Function)
        first = last_argument.arguments[0] if last_argument.arguments else Number(0)
        if fitting.aggregate.function == "count":
            yield WeightedTuple(number, (0, 1))
        elif fitting.aggregate.function != "sum" or (isinstance(first, Number) and first.value):
            yield WeightedTuple(number, order_key(first))


def _exclusive_groups(
    choices: list[WeightedTuple], denied: Sequence[Bits], rules: Rules
) -> list[list[WeightedTuple]]:
    """The tuples in groups of which at most one is in the set, because its fluents deny those
    of the others.
    """
    groups: list[list[WeightedTuple]] = []
    fluents = {choice.atom: _needed_fluents(choice.atom, rules, len(denied)) for choice in choices}
    for choice_entry in choices:
        for group in groups:
            if all(
                _exclude_each_other(fluents[choice_entry.atom], fluents[member.atom], denied)
                for member in group
            ):
                group.append(choice_entry)
                break
        else:
            groups.append([choice_entry])
    return groups


def _needed_fluents(atom: int, rules: Rules, size: int) -> list[list[int]]:
    """For each rule of a collected atom the fluents that it needs."""
    return [[fluent for fluent in body if 0 <= fluent < size] for body in rules.get(atom, [])]


def _exclude_each_other(
    first_bodies: list[list[int]], second_bodies: list[list[int]], denied: Sequence[Bits]
) -> bool:
    return all(
        any(denied[a] >> b & 1 and denied[b] >> a & 1 for a in first for b in second)
        for first in first_bodies
        for second in second_bodies
    )


class _Diagram:
    """The rules of one aggregate over groups of tuples."""

    def __init__(
        self,
        function: str,
        groups: list[list[WeightedTuple]],
        test: AggregateTest,
        universe: Universe,
        rules: Rules,
    ) -> None:
        self.groups, self.test, self.universe, self.rules = groups, test, universe, rules
        self.join: Callable[[Key, Key], Key] = _JOIN_FUNCTIONS[function]
        self.start = _START_KEYS[function]
        self.function = function
        self.low, self.high = self._ranges()
        self.known: dict[tuple[DiagramBody, ...], int] = {}

    def _ranges(self) -> tuple[list[Key], list[Key]]:
        """For each place the least and the greatest value of all groups from there on."""
        low, high = [self.start], [self.start]
        for group in reversed(self.groups):
            options = [choice.weight for choice in group]
            low.append(min(low[-1], *(self.join(low[-1], option) for option in options)))
            high.append(max(high[-1], *(self.join(high[-1], option) for option in options)))
        return low[::-1], high[::-1]

    def _verdict(self, place: int, value: Key) -> bool | None:
        return self.test.verdict(
            self.join(value, self.low[place]), self.join(value, self.high[place])
        )

    def bodies(self) -> list[DiagramBody]:
        """The bodies of the rules that make the aggregate fit."""
        levels = [{self.start}]
        for place, group in enumerate(self.groups):
            open_ = [value for value in levels[-1] if self._verdict(place, value) is None]
            next_values = {self.join(value, choice.weight) for value in open_ for choice in group}
            levels.append(next_values.union(open_))
            if sum(map(len, levels)) > MAX_DIAGRAM_NODES:
                raise OverflowError
        after: dict[Key, list[DiagramBody]] = {}
        for place in reversed(range(len(levels))):
            named = {value: self._named(bodies) for value, bodies in after.items()}
            after = {
                value: self._at(place, value, named) for value in sorted(levels[place], key=repr)
            }
        return after[self.start]

    def _at(
        self, place: int, value: Key, after: Mapping[Key, DiagramBody | None]
    ) -> list[DiagramBody]:
        """The bodies for a value at a place, from what follows at the next place."""
        verdict = self._verdict(place, value)
        if verdict is not None:
            return [()] if verdict else []
        group, direction = self.groups[place], self.test.direction
        bodies: list[DiagramBody] = []
        for choice in group:
            then = after[self.join(value, choice.weight)]
            if then is not None and direction * self._side(choice) >= 0:
                bodies.append((choice.atom, *then))
            if then is not None and direction and direction * self._side(choice) < 0:
                worse = (o.atom for o in group if direction * self._rank(o, choice) < 0)
                bodies.append((*(~atom for atom in worse), *then))
        then = after[value]
        if then is not None:
            excluded = (o.atom for o in group if not direction or direction * self._side(o) < 0)
            bodies.append((*(~atom for atom in excluded), *then))
        if () in bodies:
            return [()]
        return list(dict.fromkeys(bodies))

    def _side(self, choice: WeightedTuple) -> int:
        """1 if a tuple makes the value larger than without it, else -1."""
        if self.function in ("min", "max"):
            return 1 if self.function == "max" else -1
        return 1 if choice.weight > (0, 0) else -1

    def _rank(self, first: WeightedTuple, second: WeightedTuple) -> int:
        return (first.weight > second.weight) - (first.weight < second.weight)

    def _named(self, bodies: list[DiagramBody]) -> DiagramBody | None:
        """What stands for some bodies in the bodies before: nothing, a single literal, or a new
        derived atom; None if none.
        """
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


def _add_keys(first: Key, second: Key) -> Key:
    assert isinstance(first[1], int)
    assert isinstance(second[1], int)
    return (0, first[1] + second[1])


_JOIN_FUNCTIONS: Mapping[str, Callable[[Key, Key], Key]] = {
    "count": _add_keys,
    "sum": _add_keys,
    "min": min,
    "max": max,
}
_START_KEYS: Mapping[str, Key] = {
    "count": (0, 0),
    "sum": (0, 0),
    "min": HIGHEST_KEY,
    "max": LOWEST_KEY,
}
