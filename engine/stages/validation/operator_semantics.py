"""Semantics of operators: what a step does, taken from the domain (language, Meaning 2 to 7).

The code works on sets of atoms and is plain on purpose. It deduces atom by atom, and it evaluates
the rules of derived predicates in every state.
"""

import copy
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.stages.validation.checker_facts import (
    CheckerFacts,
    CompletedFacts,
    EvaluatedFacts,
)
from cellwright.engine.stages.validation.condition_solving import Bindings, solve_conditions
from cellwright.engine.stages.validation.prepared_operators import PreparedOperator
from cellwright.engine.stages.validation.rule_derivation import RuleDerivation
from cellwright.engine.stages.validation.step_changes import (
    CheckedChange,
    Denial,
    State,
    StaticDeductions,
    StepDemands,
    StepEffects,
    as_named,
    demands_of,
    effects_of,
    remember_value,
)
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.graphs import reachable_vertices, strong_components
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    Condition,
    Literal,
    Parameter,
    literals_in,
)
from cellwright.kb.model.domain_model import Kind, Operator, Rule
from cellwright.kb.model.operator_amounts import Amounts
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, substitute_atom


@dataclass
class Semantics:
    """The static facts of a problem, evaluated once by clingo, and the meaning of its operators
    over them.

    What static facts alone decide is remembered: whether steps exist, and what follows from an
    atom.
    """

    problem: Problem
    _where: dict[Body, Body] = field(default_factory=dict)
    _start: State | None = None
    _bound: dict[Function, tuple[Operator, Bindings] | str] = field(default_factory=dict)
    _demands: dict[Function, StepDemands] = field(default_factory=dict)
    _changes: dict[Function, StepEffects] = field(default_factory=dict)
    _operators: dict[str, PreparedOperator] = field(default_factory=dict)
    _fluents: dict[str, frozenset[str]] = field(default_factory=dict)

    def about(self, problem: Problem, state: State | None = None) -> "Semantics | None":
        """The semantics of another problem with the same domain, objects and static facts; None if
        they differ.

        The static facts are not evaluated again. `state` replaces the initial state of the problem.
        """
        own = self.problem
        pairs = (
            (problem.statics, own.statics),
            (problem.objects, own.objects),
            (problem.durations, own.durations),
        )
        same = problem.domain is own.domain and all(
            mine is theirs or mine == theirs for mine, theirs in pairs
        )
        if not same:
            return None
        # made once for all these problems
        _ = self.statics, self.amounts, self._derivation, self._deductions
        shared = copy.copy(self)
        shared.problem, shared._start = problem, state
        return shared

    def __post_init__(self) -> None:
        domain = self.problem.domain
        self.operators = {operator.name: operator for operator in domain.operators}
        self._kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self._rules: dict[str, list[Rule]] = defaultdict(list)
        for rule in domain.rules:
            self._rules[rule.head.name].append(rule)

    @cached_property
    def statics(self) -> CheckerFacts:
        """Every static fact, types included.

        Each body with aggregates gets a predicate of its own.
        """
        grounder = evaluate_statics(self.problem, self._aggregate_rules())
        return EvaluatedFacts(grounder.named, grounder.holds, grounder.has_more)

    @cached_property
    def amounts(self) -> Amounts:
        """The durations and costs of the problem's steps."""
        return amounts_of(self.problem, self._facts_of)

    def _facts_of(self, name: str, arity: int) -> Iterator[tuple[Term, ...]]:
        return (fact.arguments for fact in self.statics.named(name) if len(fact.arguments) == arity)

    def _aggregate_rules(self) -> Iterator[str]:
        domain = self.problem.domain
        bodies = [(operator.body, operator.parameters) for operator in domain.operators]
        bodies += [
            ((*d.body, *c.body), c.parameters)
            for d in domain.deductive_operators
            for c in d.consequences
        ]
        bodies += [(default.body, default.parameters) for default in domain.defaults]
        for number, (body, parameters) in enumerate(bodies):
            if any(isinstance(part, Aggregate) for part in body):
                head = Function(
                    f"_where_{number}", tuple(parameter.variable for parameter in parameters)
                )
                yield f"{head} :- {', '.join([*type_guard(parameters), *map(str, body)])}."
                self._where[body] = (Literal(head),)

    def body(self, body: Body) -> Body:
        """The body; if it has aggregates, the predicate that clingo has evaluated for it."""
        return self._where.get(body, body) if self.statics and self._where else body

    def facts(self, state: Iterable[Atom] | CheckerFacts) -> CheckerFacts:
        """A state with its derived atoms, on top of the static facts."""
        if not self._rules:
            return self.layer(state)
        return CompletedFacts((), self.layer(state), self._rules, self._complete)

    def _complete(self, facts: CompletedFacts, name: str) -> None:
        self._derivation.add(facts, facts.settle(self._behind(name)))

    def layer(self, state: Iterable[Atom] | CheckerFacts) -> CheckerFacts:
        """A state as facts on top of the static facts.

        `Facts.after` makes the next state with less work.
        """
        return state if isinstance(state, CheckerFacts) else CheckerFacts(state, self.statics)

    def bounds(
        self, certain: Iterable[Atom], possible: Iterable[Atom] | CheckerFacts
    ) -> tuple[CheckerFacts, CheckerFacts]:
        """What is true in every state between two sets of atoms, and what can be true, with
        derived atoms.
        """

        def complete(_facts: CompletedFacts, name: str) -> None:
            behind = self._behind(name)
            self._derivation.bound(lower, upper, lower.settle(behind) | upper.settle(behind))

        lower = CompletedFacts(certain, self.statics, self._rules, complete)
        upper = CompletedFacts(possible, self.statics, self._rules, complete)
        return lower, upper

    @cached_property
    def _deductions(self) -> StaticDeductions:
        statics = self.statics  # evaluates bodies with aggregates, too
        return StaticDeductions(self.problem.domain.deductive_operators, statics, self._where)

    @cached_property
    def _derivation(self) -> RuleDerivation:
        dynamic = {
            name for name, kind in self._kinds.items() if kind in (Kind.FLUENT, Kind.DERIVED)
        }
        return RuleDerivation(self.strata, self.statics, dynamic)

    @cached_property
    def strata(self) -> list[list[Rule]]:
        """The rules of derived predicates, in an order in which a negated predicate comes
        before its users.
        """
        return [
            [rule for name in sorted(part) for rule in self._rules[name]]
            for part in strong_components(self._uses)
        ]

    @cached_property
    def _uses(self) -> dict[str, list[str]]:
        graph: dict[str, list[str]] = {}
        for name, rules in self._rules.items():
            used = (
                literal.atom.name
                for rule in rules
                for part in rule.body
                for literal in literals_in(part)
            )
            graph[name] = [used_name for used_name in used if used_name in self._rules]
        return graph

    def _behind(self, name: str) -> set[str]:
        """The derived predicates that a derived predicate depends on, and itself."""
        return set(reachable_vertices(self._uses, name))

    def fluents_behind(self, name: str) -> frozenset[str]:
        """The fluents that a predicate depends on: the predicate itself, or those that its
        rules lead to.
        """
        if name not in self._fluents:
            self._fluents[name] = frozenset(self._fluents_of(name))
        return self._fluents[name]

    def _fluents_of(self, name: str) -> set[str]:
        if name not in self._rules:
            return {name} if self._kinds.get(name) is Kind.FLUENT else set()
        used = {
            literal.atom.name
            for rule_name in reachable_vertices(self._uses, name)
            for rule in self._rules[rule_name]
            for part in rule.body
            for literal in literals_in(part)
        }
        return {used_name for used_name in used if self._kinds.get(used_name) is Kind.FLUENT}

    def initial(self) -> State:
        """The initial state (point 6 of "Meaning")."""
        if self._start is not None:
            return self._start
        if self.problem.complete:
            return frozenset(self.problem.initial)
        given_facts = frozenset(self.problem.initial)
        change = self.deduce(given_facts, (), given_facts)
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
        instances = {
            substitute_atom(atom, bindings)
            for bindings in solve_conditions((*typed, *body), self.statics, {})
        }
        return sorted(instances, key=str)

    def binding(self, step: Function) -> tuple[Operator, Bindings] | str:
        """The operator of a step and the values of its parameters; a text with the reason if
        there are none.
        """
        if step not in self._bound:
            remember_value(self._bound, step, self._binding(step))
        return self._bound[step]

    def _binding(self, step: Function) -> tuple[Operator, Bindings] | str:
        operator = self.operators.get(step.name)
        if operator is None or len(operator.parameters) != len(step.arguments):
            return f"there is no operator {step.name}/{len(step.arguments)}"
        bindings = dict(zip(operator.variables, step.arguments, strict=True))
        for parameter in operator.parameters:
            if not self.statics.has_type(bindings[parameter.variable], parameter.type):
                return f"{bindings[parameter.variable]} is no {parameter.type}"
        if next(solve_conditions(self.body(operator.body), self.statics, bindings), None) is None:
            return f"its constraints do not hold: {', '.join(map(str, operator.body))}"
        return operator, bindings

    def demands(self, step: Function, operator: Operator, bindings: Bindings) -> StepDemands:
        """What a step holds, how long it lasts and what it costs. Raises `NoAmount`."""
        if step not in self._demands:
            remember_value(self._demands, step, demands_of(operator, bindings, self.amounts))
        return self._demands[step]

    def change(
        self,
        operator: Operator,
        bindings: Bindings,
        facts: CheckerFacts,
        state: State | CheckerFacts,
    ) -> CheckedChange:
        """What a step does in a state; `facts` is the state with its derived atoms."""
        effects = self._effects(operator, bindings, facts)
        if self._deductions.none:
            return as_named(effects, self.layer(state))
        return replace(self.deduce(effects.added, effects.denials, state), events=effects.events)

    def _effects(self, operator: Operator, bindings: Bindings, facts: CheckerFacts) -> StepEffects:
        prepared, values = (
            self._prepared(operator),
            [bindings[variable] for variable in operator.variables],
        )
        if not prepared.unconditional:
            return effects_of(prepared.fired(facts, values), self._kinds)
        key = Function(operator.name, tuple(values))
        effects = self._changes.get(key)
        if effects is None:
            effects = remember_value(
                self._changes, key, effects_of(prepared.fired(facts, values), self._kinds)
            )
        return effects

    def unmet(self, operator: Operator, step: Function, facts: CheckerFacts) -> Condition | None:
        """The first conjunct of the precondition of a step that does not hold; None if all hold."""
        return self._prepared(operator).unmet(facts, step.arguments)

    def _prepared(self, operator: Operator) -> PreparedOperator:
        own_operator = self._operators.get(operator.name)
        if own_operator is None or own_operator.operator is not operator:
            own_operator = self._operators[operator.name] = PreparedOperator(operator)
        return own_operator

    def deduce(
        self, added: Iterable[Atom], explicit: tuple[Denial, ...], state: State | CheckerFacts
    ) -> CheckedChange:
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
        contradiction = next(
            (a for a in adds if any(d.matches(a, self.statics) for d in deduced)), None
        )
        ends = frozenset(atom for atom in ended if atom not in adds)
        return CheckedChange(
            frozenset(adds), ends, tuple(denials), frozenset(triggered), contradiction
        )
