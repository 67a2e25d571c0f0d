"""Bindings under which a MACROP serves a query: a join over its parts, in an order found once."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.stages.lifted.fact_queries import (
    Bindings,
    FactSet,
    is_satisfiable,
    solve_body,
)
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery
from cellwright.kb.arithmetic import compare_terms
from cellwright.kb.model.conditions import (
    Aggregate,
    Comparison,
    Literal,
    Parameter,
    StateAggregate,
    part_variables,
    substitute_part,
)
from cellwright.kb.model.plan_model import MacroChain, Macrop
from cellwright.kb.model.planning_problem import Chain
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Text,
    Variable,
    is_ground,
    match_term,
    substitute_atom,
    substitute_term,
)
from cellwright.kb.terms import term_variables as variables_of


@dataclass(frozen=True, slots=True)
class MatchItem:
    """One part of a MACROP that must be satisfied.

    `kind` says by what: a `goal` or `chain` of the query, an atom of the `state`, a `static` fact,
    or a `type`.
    """

    kind: str
    part: Literal | Parameter | Comparison | MacroChain
    variables: frozenset[Variable]


@dataclass(frozen=True, slots=True)
class GoalTests:
    """A goal with the tests on its variables alone.

    Those that are `fixed` ask the statics, those that are `changing` the state. Goals with equal
    `key` fit the same goals of a query; those with equal `fixed_key` do so as far as the statics
    decide.
    """

    part: Literal
    variables: tuple[Variable, ...]
    fixed: tuple[MatchItem, ...]
    changing: tuple[MatchItem, ...]
    fixed_key: str
    key: str


@dataclass(frozen=True)
class MatchingOrder:
    """The order in which the parts of a MACROP are matched.

    Each part of it is computed at its first use.
    """

    macrop: Macrop

    @cached_property
    def items(self) -> tuple[MatchItem, ...]:
        """The parts in order. Goals and chains come first, each followed by the tests that it
        decides.
        """
        chains = [_make_item("chain", chain) for chain in _in_order(self.macrop.chains)]
        return tuple(_order_items([*_goal_items(self.macrop), *chains], list(self.tests), set()))

    @cached_property
    def tests(self) -> tuple[MatchItem, ...]:
        """Preconditions, constraints and types."""
        return tuple(_test_items(self.macrop))

    @cached_property
    def wanted(self) -> tuple[GoalTests, ...]:
        """The goals, each with the tests of its own variables."""
        return tuple(_goal_tests(goal, self.tests) for goal in _goal_items(self.macrop))

    @cached_property
    def between(self) -> tuple[MatchItem, ...]:
        """The tests that several goals decide together."""
        return tuple(
            test
            for test in self.tests
            if test.variables <= self._bound and id(test) not in self._own
        )

    @cached_property
    def rest(self) -> tuple[MatchItem, ...]:
        """The tests that remain when all goals are bound."""
        return tuple(
            _order_items(
                [], [test for test in self.tests if not test.variables <= self._bound], self._bound
            )
        )

    def prepare(self) -> None:
        """Compute now what matching asks for."""
        _ = (self.between, self.rest) if not self.macrop.chains else self.items

    @cached_property
    def _bound(self) -> set[Variable]:
        return {variable for goal in self.wanted for variable in goal.variables}

    @cached_property
    def _own(self) -> set[int]:
        return {id(item) for goal in self.wanted for item in (*goal.fixed, *goal.changing)}


def _goal_items(macrop: Macrop) -> list[MatchItem]:
    return [_make_item("goal", goal) for goal in macrop.goals]


def _test_items(macrop: Macrop) -> list[MatchItem]:
    items = [_make_item("state", precondition) for precondition in macrop.preconditions]
    tests = (*macrop.constraints, *macrop.disequalities)
    items += [
        _make_item("static", test)
        for test in tests
        if not isinstance(test, Aggregate | StateAggregate)
    ]
    return items + [_make_item("type", type_test) for type_test in macrop.types]


def _goal_tests(goal: MatchItem, tests: Iterable[MatchItem]) -> GoalTests:
    assert isinstance(goal.part, Literal)
    order = tuple(dict.fromkeys(variables_of(goal.part.atom)))
    own = tuple(item for item in tests if item.variables and item.variables <= goal.variables)
    names = {variable: Variable(f"V{number}") for number, variable in enumerate(order)}
    fixed = tuple(item for item in own if item.kind != "state")
    changing = tuple(item for item in own if item.kind == "state")
    fixed_key, rest = (_items_text(items, names) for items in ((goal, *fixed), changing))
    return GoalTests(goal.part, order, fixed, changing, fixed_key, f"{fixed_key}\n{rest}")


def _items_text(items: Iterable[MatchItem], names: Mapping[Variable, Variable]) -> str:
    return "\n".join(f"{item.kind} {_renamed_text(item.part, names)}" for item in items)


def _renamed_text(
    part: Literal | Parameter | Comparison | MacroChain, names: Mapping[Variable, Variable]
) -> str:
    if isinstance(part, Parameter):
        return f"{part.type} {names[part.variable]}"
    return str(substitute_part(part, names)) if not isinstance(part, MacroChain) else str(part)


def _order_items(
    asked: list[MatchItem], pending: list[MatchItem], bound: set[Variable]
) -> Iterator[MatchItem]:
    bound = set(bound)
    while asked:
        yield from _take_decided(pending, bound)
        item = asked.pop(0)
        yield item
        bound |= item.variables
    while pending:
        item = min(pending, key=lambda candidate: _item_rank(candidate, bound))
        pending.remove(item)
        yield item
        bound |= item.variables


def _take_decided(pending: list[MatchItem], bound: set[Variable]) -> list[MatchItem]:
    """Remove the items without open variables from `pending`, and return them, types first."""
    decided = [item for item in pending if item.variables <= bound]
    pending[:] = [item for item in pending if not item.variables <= bound]
    return sorted(decided, key=lambda item: item.kind != "type")


def _in_order(chains: Sequence[MacroChain]) -> list[MacroChain]:
    """The chains, each behind those that it must come after."""
    placed: list[MacroChain] = []
    waiting = list(chains)
    while waiting:
        placed_names = {chain.name for chain in placed}
        ready = [chain for chain in waiting if placed_names.issuperset(chain.after)] or waiting
        placed += ready
        waiting = [chain for chain in waiting if chain not in ready]
    return placed


def _make_item(kind: str, part: Literal | Parameter | Comparison | MacroChain) -> MatchItem:
    if isinstance(part, Parameter):
        return MatchItem(kind, part, frozenset({part.variable}))
    if isinstance(part, MacroChain):
        terms = [part.name, *part.stages, *([part.subject] if part.subject is not None else [])]
        return MatchItem(kind, part, frozenset(v for term in terms for v in variables_of(term)))
    return MatchItem(kind, part, frozenset(part_variables(part)))


def _item_rank(item: MatchItem, bound: set[Variable]) -> tuple[int, int]:
    open_ = len(item.variables - bound)
    if not open_:
        return 0, 0 if item.kind == "type" else 1
    if isinstance(item.part, Literal) and item.part.positive:
        return (1 if item.kind == "state" else 2), open_
    return (3, open_) if isinstance(item.part, Parameter) else (4, open_)


MAX_MATCHING_STEPS = 5_000
MAX_REMEMBERED_GOALS = 1 << 16  # goals whose values are remembered


class OutOfWork(Exception):
    """Matching took more steps than it is allowed."""


@dataclass
class MatchingBudget:
    """The number of matching steps that are left."""

    left: int = MAX_MATCHING_STEPS

    def spend(self) -> None:
        """Count one step. Raises `OutOfWork` if none is left."""
        self.left -= 1
        if self.left < 0:
            raise OutOfWork


def match_macro(
    program: MatchingOrder, asked: MacroQuery, work: MatchingBudget
) -> Iterator[dict[Variable, Term]]:
    """Every binding that satisfies the MACROP's goals, preconditions and constraints.

    Raises `OutOfWork`.
    """
    macrop = program.macrop
    if (len(macrop.goals), len(macrop.chains)) != (len(asked.goals), len(asked.chains)):
        return
    for solution in _macro_solutions(program, asked, work):
        if not any(
            is_satisfiable(body, asked.world.statics, solution) for body in macrop.exclusions
        ):
            yield solution


def join_macro_goals(
    program: MatchingOrder, asked: MacroQuery, work: MatchingBudget
) -> Iterator[dict[Variable, Term]]:
    """The bindings before exclusions are tested. Goals are bound one by one, in the MACROP's own
    order.

    This way works for workflow chains and for goals with `_`, too.
    """
    return _Matching(program.items, asked, work).solutions(0, {}, (), frozenset())


def _macro_solutions(
    program: MatchingOrder, asked: MacroQuery, work: MatchingBudget
) -> Iterator[dict[Variable, Term]]:
    if asked.chains or not all(is_ground(goal.atom) for goal in asked.goals):
        yield from join_macro_goals(program, asked, work)
        return
    rest = _Matching(program.rest, asked, work)
    for bindings in _Assignment(program, asked, work).solutions():
        yield from rest.solutions(0, bindings, (), frozenset())


@dataclass(frozen=True, slots=True)
class _Assignment:
    """Assigns the goals of a query, all of them ground, to the goals of a MACROP.

    The goals with the fewest choices are assigned first.
    """

    program: MatchingOrder
    asked: MacroQuery
    work: MatchingBudget

    def solutions(self) -> Iterator[Bindings]:
        """The bindings of the goals' variables under which all tests hold that they decide."""
        choices = [self._choices(goal_tests) for goal_tests in self.program.wanted]
        if all(choices):
            order = sorted(range(len(choices)), key=lambda place: len(choices[place]))
            yield from self._given(
                [choices[place] for place in order], order, {}, 0, list(self.program.between)
            )

    def _choices(self, goal_tests: GoalTests) -> tuple[tuple[int, tuple[Term, ...]], ...]:
        """The numbers of the query's goals that fit, with the values of the variables.

        They are shared by all MACROPs with the same tests.
        """
        goal_choices = self.asked.memory.get(goal_tests.key)
        if goal_choices is None:
            goal_choices = self.asked.memory[goal_tests.key] = tuple(self._fitting(goal_tests))
        return goal_choices

    def _fitting(self, goal_tests: GoalTests) -> Iterator[tuple[int, tuple[Term, ...]]]:
        tests = _Matching((), self.asked, self.work)
        for number, goal in enumerate(self.asked.goals):
            self.work.spend()
            values = (
                self._known(goal_tests, goal.atom, tests)
                if goal.positive == goal_tests.part.positive
                else None
            )
            if values is None:
                continue
            bindings = (
                dict(zip(goal_tests.variables, values, strict=True)) if goal_tests.changing else {}
            )
            if all(tests.test(item, bindings) for item in goal_tests.changing):
                yield number, values

    def _known(
        self, goal_tests: GoalTests, goal: Atom, tests: "_Matching"
    ) -> tuple[Term, ...] | None:
        """The values of the variables if a goal fits, as far as the statics decide: queries in
        one cell have the same goals.
        """
        cache, key = self.asked.world.fitting, (goal_tests.fixed_key, goal)
        if key not in cache:
            if len(cache) >= MAX_REMEMBERED_GOALS:
                cache.clear()
            match_bindings = match_term(goal_tests.part.atom, goal, {})
            fits = match_bindings is not None and all(
                tests.test(item, match_bindings) for item in goal_tests.fixed
            )
            cache[key] = (
                tuple(match_bindings[variable] for variable in goal_tests.variables)
                if match_bindings is not None and fits
                else None
            )
        return cache[key]

    def _given(
        self,
        choices: Sequence[tuple[tuple[int, tuple[Term, ...]], ...]],
        order: Sequence[int],
        bindings: dict[Variable, Term],
        taken: int,
        open_: list[MatchItem],
    ) -> Iterator[Bindings]:
        if not order:
            yield bindings
            return
        variables = self.program.wanted[order[0]].variables
        for number, values in choices[0]:
            if taken >> number & 1:
                continue
            self.work.spend()
            extended = _extend_values(bindings, variables, values)
            if extended is None:
                continue
            tests_left = self._untested(open_, extended)
            if tests_left is not None:
                yield from self._given(
                    choices[1:], order[1:], extended, taken | 1 << number, tests_left
                )

    def _untested(
        self, open_: list[MatchItem], bindings: dict[Variable, Term]
    ) -> list[MatchItem] | None:
        """The tests that still have open variables; None if one of the others is false."""
        tests = _Matching((), self.asked, self.work)
        tests_left = []
        for item in open_:
            if not item.variables <= bindings.keys():
                tests_left.append(item)
            elif not tests.test(item, bindings):
                return None
        return tests_left


def _extend_values(
    bindings: dict[Variable, Term], variables: Sequence[Variable], values: Sequence[Term]
) -> dict[Variable, Term] | None:
    extended = bindings.copy()
    for variable, value in zip(variables, values, strict=True):
        if extended.setdefault(variable, value) != value:
            return None
    return extended


@dataclass(frozen=True, slots=True)
class _Matching:
    items: tuple[MatchItem, ...]
    asked: MacroQuery
    work: MatchingBudget

    def solutions(
        self,
        place: int,
        bindings: Bindings,
        waiting: tuple[MatchItem, ...],
        taken: frozenset[object],
    ) -> Iterator[dict[Variable, Term]]:
        """The bindings that satisfy all items from `place` on.

        `taken` are the goals and chains that are already served.
        """
        while place < len(self.items):
            self.work.spend()
            item = self.items[place]
            place += 1
            if item.kind in ("goal", "chain"):
                for served, extended in self._served(item, bindings, taken):
                    yield from self.solutions(place, extended, waiting, taken | {served})
                return
            truth = self.test(item, bindings)
            if truth is None and _must_wait(item.part):
                waiting = (*waiting, item)
            elif not truth:
                for extended in self._bindings(item, bindings) if truth is None else ():
                    yield from self.solutions(place, extended, waiting, taken)
                return
        if all(self._finally(item, bindings) for item in waiting):
            yield dict(bindings)

    def _served(
        self, item: MatchItem, bindings: Bindings, taken: frozenset[object]
    ) -> Iterator[tuple[Literal | Chain, Bindings]]:
        """The free goals or chains of the query that the item can serve, each with its bindings."""
        candidates: Iterable[Literal | Chain] = (
            self.asked.goals if item.kind == "goal" else self.asked.chains
        )
        for candidate in candidates:
            if candidate in taken:
                continue
            self.work.spend()
            if isinstance(candidate, Literal) and isinstance(item.part, Literal):
                same = item.part.positive == candidate.positive
                match_bindings = (
                    match_open(item.part.atom, candidate.atom, bindings) if same else None
                )
            elif isinstance(candidate, Chain) and isinstance(item.part, MacroChain):
                match_bindings = _match_chain(item.part, candidate, bindings)
            else:
                continue
            if match_bindings is not None:
                yield candidate, match_bindings

    def test(self, item: MatchItem, bindings: Bindings) -> bool | None:
        """Whether an item holds; None while it has open variables."""
        part = item.part
        if isinstance(part, Parameter):
            value = bindings.get(part.variable)
            return (
                self.asked.world.statics.has_type(value, part.type) if value is not None else None
            )
        if not item.variables <= bindings.keys():
            return None
        if isinstance(part, Comparison):
            return compare_terms(
                substitute_term(part.left, bindings),
                part.relation,
                substitute_term(part.right, bindings),
            )
        if isinstance(part, Literal):
            return (substitute_atom(part.atom, bindings) in self._facts(item)) == part.positive
        return None

    def _facts(self, item: MatchItem) -> FactSet:
        return self.asked.facts if item.kind == "state" else self.asked.world.statics

    def _bindings(self, item: MatchItem, bindings: Bindings) -> Iterator[Bindings]:
        if isinstance(item.part, Parameter):
            typed_facts = self.asked.world.statics.named(item.part.type)
            yield from ({**bindings, item.part.variable: atom.arguments[0]} for atom in typed_facts)
        elif not isinstance(item.part, MacroChain):
            yield from solve_body((item.part,), self._facts(item), bindings)

    def _finally(self, item: MatchItem, bindings: Bindings) -> bool:
        if isinstance(item.part, Parameter | MacroChain):
            return True
        return is_satisfiable((item.part,), self._facts(item), bindings)


def match_open(pattern: Term, term: Term, bindings: Bindings) -> Bindings | None:
    """The same as `match`, except that `_` in the given term fits anything and binds nothing."""
    if term == ANYTHING:
        return bindings
    if isinstance(pattern, Function) and isinstance(term, Function) and term.arguments:
        if pattern.name != term.name or len(pattern.arguments) != len(term.arguments):
            return None
        match_bindings: Bindings | None = bindings
        for pattern_argument, term_argument in zip(pattern.arguments, term.arguments, strict=True):
            match_bindings = (
                match_open(pattern_argument, term_argument, match_bindings)
                if match_bindings is not None
                else None
            )
        return match_bindings
    return match_term(pattern, term, bindings) if is_ground(term) else None


def _match_chain(macro_chain: MacroChain, chain: Chain, bindings: Bindings) -> Bindings | None:
    if len(macro_chain.stages) != len(chain.stages) or (macro_chain.subject is None) != (
        chain.subject is None
    ):
        return None
    match_bindings: Bindings | None = match_term(macro_chain.name, Text(chain.name), bindings)
    if match_bindings is not None and macro_chain.subject is not None and chain.subject is not None:
        match_bindings = match_term(macro_chain.subject, chain.subject, match_bindings)
    for stage, term in zip(macro_chain.stages, chain.stages, strict=True):
        match_bindings = (
            match_open(stage, term, match_bindings) if match_bindings is not None else None
        )
    if match_bindings is None or {
        substitute_term(name, match_bindings) for name in macro_chain.after
    } != set(map(Text, chain.after)):
        return None
    return match_bindings


def _must_wait(part: Literal | Parameter | Comparison | MacroChain) -> bool:
    return (isinstance(part, Literal) and not part.positive) or (
        isinstance(part, Comparison) and part.relation != "="
    )
