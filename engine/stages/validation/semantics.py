"""What a step does, taken directly from the domain (docs/language.md, "Meaning", points 2 to 7).

The code works on sets of atoms and is plain on purpose. It deduces atom by atom, and it evaluates the rules of derived
predicates in every state.
"""

import copy
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.stages.validation.changes import Denial, State, StepChange
from cellwright.engine.stages.validation.datalog import Bindings, solve
from cellwright.engine.stages.validation.deductions import Deductions, remembered
from cellwright.engine.stages.validation.derivation import Derivation
from cellwright.engine.stages.validation.evaluated import Evaluated
from cellwright.engine.stages.validation.facts import Deduced, Facts
from cellwright.engine.stages.validation.instances import (
    Demands,
    Effects,
    as_named,
    demands_of,
    effects_of,
)
from cellwright.engine.stages.validation.prepared import Prepared
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.asp.vocabulary import guard
from cellwright.kb.graphs import components, reached
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.amounts import Amounts
from cellwright.kb.model.conditions import Aggregate, Body, Condition, Literal, Parameter, literals
from cellwright.kb.model.domain import Kind, Operator, Rule
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, substitute_atom


@dataclass
class Semantics:
    """The static facts of a problem, evaluated once by clingo, and the meaning of its operators over them.

    What static facts alone decide is remembered: whether steps exist, and what follows from an atom.
    """

    problem: Problem
    _where: dict[Body, Body] = field(default_factory=dict)
    _start: State | None = None
    _bound: dict[Function, tuple[Operator, Bindings] | str] = field(default_factory=dict)
    _demands: dict[Function, Demands] = field(default_factory=dict)
    _changes: dict[Function, Effects] = field(default_factory=dict)
    _operators: dict[str, Prepared] = field(default_factory=dict)
    _fluents: dict[str, frozenset[str]] = field(default_factory=dict)

    def about(self, problem: Problem, state: State | None = None) -> "Semantics | None":
        """The semantics of another problem with the same domain, objects and static facts; None if they
        differ.

        The static facts are not evaluated again. `state` replaces the initial state of the problem.
        """
        own = self.problem
        pairs = (
            (problem.statics, own.statics),
            (problem.objects, own.objects),
            (problem.durations, own.durations),
        )
        same = problem.domain is own.domain and all(one is other or one == other for one, other in pairs)
        if not same:
            return None
        _ = self.statics, self.amounts, self._derivation, self._deductions  # made once for all these problems
        shared = copy.copy(self)
        shared.problem, shared._start = problem, state
        return shared

    def __post_init__(self) -> None:
        domain = self.problem.domain
        self.operators = {each.name: each for each in domain.operators}
        self._kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self._rules: dict[str, list[Rule]] = defaultdict(list)
        for rule in domain.rules:
            self._rules[rule.head.name].append(rule)

    @cached_property
    def statics(self) -> Facts:
        """Every static fact, types included. Each body with aggregates gets a predicate of its own."""
        grounder = evaluated(self.problem, self._aggregate_rules())
        return Evaluated(grounder.named, grounder.holds)

    @cached_property
    def amounts(self) -> Amounts:
        """The durations and costs of the problem's steps."""
        return amounts_of(self.problem, self._facts_of)

    def _facts_of(self, name: str, arity: int) -> Iterator[tuple[Term, ...]]:
        return (each.arguments for each in self.statics.named(name) if len(each.arguments) == arity)

    def _aggregate_rules(self) -> Iterator[str]:
        domain = self.problem.domain
        bodies = [(each.body, each.parameters) for each in domain.operators]
        bodies += [
            ((*d.body, *c.body), c.parameters) for d in domain.deductive_operators for c in d.consequences
        ]
        bodies += [(default.body, default.parameters) for default in domain.defaults]
        for number, (body, parameters) in enumerate(bodies):
            if any(isinstance(part, Aggregate) for part in body):
                head = Function(f"_where_{number}", tuple(parameter.variable for parameter in parameters))
                yield f"{head} :- {', '.join([*guard(parameters), *map(str, body)])}."
                self._where[body] = (Literal(head),)

    def body(self, body: Body) -> Body:
        """The body; if it has aggregates, the predicate that clingo has evaluated for it."""
        return self._where.get(body, body) if self.statics and self._where else body

    def facts(self, state: Iterable[Atom] | Facts) -> Facts:
        """A state with its derived atoms, on top of the static facts."""
        if not self._rules:
            return self.layer(state)

        def complete(name: str) -> None:
            self._derivation.add(facts, facts.settle(self._behind(name)))

        facts = Deduced((), self.layer(state), self._rules, complete)
        return facts

    def layer(self, state: Iterable[Atom] | Facts) -> Facts:
        """A state as facts on top of the static facts. `Facts.after` makes the next state with less work."""
        return state if isinstance(state, Facts) else Facts(state, self.statics)

    def bounds(self, certain: Iterable[Atom], possible: Iterable[Atom] | Facts) -> tuple[Facts, Facts]:
        """What is true in every state between two sets of atoms, and what can be true, with derived atoms."""

        def complete(name: str) -> None:
            behind = self._behind(name)
            self._derivation.bound(lower, upper, lower.settle(behind) | upper.settle(behind))

        lower = Deduced(certain, self.statics, self._rules, complete)
        upper = Deduced(possible, self.statics, self._rules, complete)
        return lower, upper

    @cached_property
    def _deductions(self) -> Deductions:
        statics = self.statics  # evaluates bodies with aggregates, too
        return Deductions(self.problem.domain.deductive_operators, statics, self._where)

    @cached_property
    def _derivation(self) -> Derivation:
        dynamic = {name for name, kind in self._kinds.items() if kind in (Kind.FLUENT, Kind.DERIVED)}
        return Derivation(self.strata, self.statics, dynamic)

    @cached_property
    def strata(self) -> list[list[Rule]]:
        """The rules of derived predicates, in an order in which a negated predicate comes before its users."""
        return [
            [rule for name in sorted(part) for rule in self._rules[name]] for part in components(self._uses)
        ]

    @cached_property
    def _uses(self) -> dict[str, list[str]]:
        graph: dict[str, list[str]] = {}
        for name, rules in self._rules.items():
            used = (each.atom.name for rule in rules for part in rule.body for each in literals(part))
            graph[name] = [other for other in used if other in self._rules]
        return graph

    def _behind(self, name: str) -> set[str]:
        """The derived predicates that a derived predicate depends on, and itself."""
        return set(reached(self._uses, name))

    def fluents_behind(self, name: str) -> frozenset[str]:
        """The fluents that a predicate depends on: the predicate itself, or those that its rules lead to."""
        if name not in self._fluents:
            self._fluents[name] = frozenset(self._fluents_of(name))
        return self._fluents[name]

    def _fluents_of(self, name: str) -> set[str]:
        if name not in self._rules:
            return {name} if self._kinds.get(name) is Kind.FLUENT else set()
        used = {
            literal.atom.name
            for each in reached(self._uses, name)
            for rule in self._rules[each]
            for part in rule.body
            for literal in literals(part)
        }
        return {other for other in used if self._kinds.get(other) is Kind.FLUENT}

    def initial(self) -> State:
        """The initial state (point 6 of "Meaning")."""
        if self._start is not None:
            return self._start
        if self.problem.complete:
            return frozenset(self.problem.initial)
        given = frozenset(self.problem.initial)
        change = self.deduce(given, (), given)
        state, denials = set(change.adds), list(change.denials)
        for default in self.problem.domain.defaults:
            for atom in self._instances(default.atom, default.parameters, self.body(default.body)):
                more = self.deduce([atom], (), frozenset(state))
                refused = (
                    more.contradiction
                    or more.ends
                    or any(d.matches(a, self.statics) for d in denials for a in more.adds)
                )
                if not refused:
                    state |= more.adds
                    denials.extend(more.denials)
        return frozenset(state)

    def _instances(self, atom: Atom, parameters: tuple[Parameter, ...], body: Body) -> list[Atom]:
        typed = tuple(Literal(Function(p.type, (p.variable,))) for p in parameters)
        found = {substitute_atom(atom, bindings) for bindings in solve((*typed, *body), self.statics, {})}
        return sorted(found, key=str)

    def binding(self, step: Function) -> tuple[Operator, Bindings] | str:
        """The operator of a step and the values of its parameters; a text with the reason if there are none."""
        if step not in self._bound:
            remembered(self._bound, step, self._binding(step))
        return self._bound[step]

    def _binding(self, step: Function) -> tuple[Operator, Bindings] | str:
        operator = self.operators.get(step.name)
        if operator is None or len(operator.parameters) != len(step.arguments):
            return f"there is no operator {step.name}/{len(step.arguments)}"
        bindings = dict(zip(operator.variables, step.arguments, strict=True))
        for parameter in operator.parameters:
            if not self.statics.has_type(bindings[parameter.variable], parameter.type):
                return f"{bindings[parameter.variable]} is no {parameter.type}"
        if next(solve(self.body(operator.body), self.statics, bindings), None) is None:
            return f"its constraints do not hold: {', '.join(map(str, operator.body))}"
        return operator, bindings

    def demands(self, step: Function, operator: Operator, bindings: Bindings) -> Demands:
        """What a step holds, how long it lasts and what it costs. Raises `NoAmount`."""
        if step not in self._demands:
            remembered(self._demands, step, demands_of(operator, bindings, self.amounts))
        return self._demands[step]

    def change(
        self, operator: Operator, bindings: Bindings, facts: Facts, state: State | Facts
    ) -> StepChange:
        """What a step does in a state; `facts` is the state with its derived atoms."""
        made = self._effects(operator, bindings, facts)
        if self._deductions.none:
            return as_named(made, self.layer(state))
        return replace(self.deduce(made.added, made.denials, state), events=made.events)

    def _effects(self, operator: Operator, bindings: Bindings, facts: Facts) -> Effects:
        prepared, values = self._prepared(operator), [bindings[each] for each in operator.variables]
        if not prepared.unconditional:
            return effects_of(prepared.fired(facts, values), self._kinds)
        key = Function(operator.name, tuple(values))
        made = self._changes.get(key)
        if made is None:
            made = remembered(self._changes, key, effects_of(prepared.fired(facts, values), self._kinds))
        return made

    def unmet(self, operator: Operator, step: Function, facts: Facts) -> Condition | None:
        """The first conjunct of the precondition of a step that does not hold; None if all hold."""
        return self._prepared(operator).unmet(facts, step.arguments)

    def _prepared(self, operator: Operator) -> Prepared:
        found = self._operators.get(operator.name)
        if found is None or found.operator is not operator:
            found = self._operators[operator.name] = Prepared(operator)
        return found

    def deduce(self, added: Iterable[Atom], explicit: tuple[Denial, ...], state: State | Facts) -> StepChange:
        """The least fixpoint of what is added and denied, starting from `added`.

        The end of an atom has consequences only if the atom is in `state`.
        """
        current = self.layer(state)
        adds: dict[Atom, None] = {}
        denials: list[Denial] = []
        ended: dict[Atom, None] = {}
        triggered: list[Atom] = []
        waiting = list(added)
        fresh = list(explicit)
        while waiting or fresh:
            if waiting:
                atom = waiting.pop()
                if atom not in adds:
                    adds[atom] = None
                    following = self._deductions.of(atom, True)
                    waiting += following.added
                    fresh += following.denied
                continue
            denial = fresh.pop()
            denials.append(denial)
            for atom in denial.among(current, self.statics):
                if atom not in ended:
                    ended[atom] = None
                    if following := self._deductions.of(atom, False):
                        triggered.append(atom)
                        waiting += following.added
                        fresh += following.denied
        deduced = [denial for denial in denials if denial.deduced]
        contradiction = next((a for a in adds if any(d.matches(a, self.statics) for d in deduced)), None)
        ends = frozenset(atom for atom in ended if atom not in adds)
        return StepChange(frozenset(adds), ends, tuple(denials), frozenset(triggered), contradiction)
