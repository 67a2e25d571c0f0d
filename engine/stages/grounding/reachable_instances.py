"""Relaxed reachability by clingo, and the rows of numbers of all reachable instances."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    Conditional,
    Schema,
    column_name,
    conditional_body,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance_rule,
    instance_text,
    is_conditional,
    number_literals,
    reachable_literal,
    rule_text,
    signed_numbers,
)
from cellwright.engine.stages.grounding.numbered_atoms import Universe
from cellwright.engine.stages.grounding.numeric_quantities import SeparatedQuantities
from cellwright.engine.stages.grounding.operator_instances import InstanceRows
from cellwright.kb.asp.overflow import WatchedRule
from cellwright.kb.asp.static_facts import static_rules
from cellwright.kb.asp.static_program import static_program
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain_model import Effect, Rule
from cellwright.kb.terms import Atom, Function, Variable, substitute_atom, term_variables


@dataclass(frozen=True)
class ReachabilityProgram:
    """What can be reached in a problem without quantities (`taken`): by operators, under
    conditions, by derived rules.

    `goals` are the alternatives of each conjunct of the goal.
    """

    taken: SeparatedQuantities
    vocabulary: ChangingPredicates
    schemas: Sequence[Schema]
    conditionals: Sequence[Conditional]
    rules: Sequence[Rule]
    goals: Sequence[Sequence[Body]]

    def text(self, initial: Iterable[Atom]) -> Iterator[str]:
        """The statements of the program, from the atoms that are true at the start."""
        problem = self.taken.problem
        yield static_program(problem)
        yield from (f"{reachable_literal(atom)}." for atom in initial)
        yield from self._stages()
        for schema in self.schemas:
            yield instance_rule(schema, self.vocabulary)
            yield from effect_rules(schema, self.vocabulary)
            yield from self._conditional_rules(schema)
            yield from self._comparison_rules(schema)
        for rule in self.rules:
            yield derived_rule(rule, self.vocabulary)
            yield from self._compared_in(rule.body)
        for body in (body for part in self.goals for body in part):
            yield from self._compared_in(body)
        yield from (
            r for operator in problem.domain.deductive_operators for r in deduction_rules(operator)
        )

    def watched_rules(self) -> Iterator[WatchedRule]:
        """The rules of operators, their effects, derived predicates, goals and deductive
        operators, with where they stand.
        """
        problem = self.taken.problem
        yield from static_rules(problem)
        for schema in self.schemas:
            own = [instance_rule(schema, self.vocabulary), *effect_rules(schema, self.vocabulary)]
            for text in (*own, *self._conditional_rules(schema)):
                yield WatchedRule(
                    text, schema.operator.where, f"in operator {schema.operator.name}"
                )
        for each in self.rules:
            said = f"in a rule of {each.head.name}"
            yield WatchedRule(derived_rule(each, self.vocabulary), each.where, said)
        for body in (body for part in self.goals for body in part):
            goal = Rule(Function("_asked", ()), self.taken.without_tests(body))
            yield WatchedRule(derived_rule(goal, self.vocabulary), problem.where, "in the goals")
        for operator in problem.domain.deductive_operators:
            for text in deduction_rules(operator):
                yield WatchedRule(text, operator.where, "in a deductive operator")

    def _stages(self) -> Iterator[str]:
        """The events that stages of workflows name."""
        for chain in self.taken.problem.chains:
            for stage in chain.stages:
                if stage.name in self.vocabulary.events:
                    yield f"_v_{stage.name}({', '.join(map(str, stage.arguments))})."

    def _conditional_rules(self, schema: Schema) -> Iterator[str]:
        for conditional in self.conditionals:
            if conditional.operator is schema.operator and conditional.effect.adds:
                yield rule_text(
                    reachable_literal(conditional.effect.atom),
                    conditional_body(conditional, schema),
                )

    def _compared_in(self, body: Body) -> Iterator[str]:
        """Rules for the comparisons of quantities in a body, which are taken to be reachable
        wherever the rest is.
        """
        rest = self.taken.without_tests(body)
        for literal in self.taken.literals_of([each for each in body if isinstance(each, Literal)]):
            yield derived_rule(Rule(literal.atom, rest), self.vocabulary)

    def _comparison_rules(self, schema: Schema) -> Iterator[str]:
        """Rules for the comparisons of quantities in a schema, which are taken to be reachable
        wherever the rest is.
        """
        compared = [literal.atom for literal in self.taken.literals_of(schema.literals)]
        rest = tuple(literal for literal in schema.literals if literal.atom not in compared)
        body = (
            instance_rule(replace(schema, literals=rest), self.vocabulary)
            .partition(" :- ")[2]
            .rstrip(".")
        )
        for atom in compared:
            yield rule_text(reachable_literal(atom), [body] if body else [])
        for conditional in self.conditionals:
            inner = (
                self.taken.literals_of(conditional.literals)
                if conditional.operator is schema.operator
                else []
            )
            for literal in inner:
                outer_literals = tuple(p for p in conditional.literals if p not in inner)
                yield rule_text(
                    reachable_literal(literal.atom),
                    conditional_body(replace(conditional, literals=outer_literals), schema),
                )


Signed = tuple[int, ...]
ConditionalChange = tuple[Signed, Bits, Bits]  # (conditions, adds, deletes)


def read_instances(
    schemas: Sequence[Schema], vocabulary: ChangingPredicates, universe: Universe
) -> Iterator[InstanceRows]:
    """Every reachable instance of every schema."""
    tables = universe.tables(
        {f"_row_{schema.number}": _row_rule(schema, vocabulary) for schema in schemas}
    )
    for schema in schemas:
        adds, _ = _plain_changes(schema, vocabulary)
        yield InstanceRows(schema, tables.pop(f"_row_{schema.number}"), len(adds))


def conditional_changes(
    conditionals: Sequence[Conditional], schemas: Sequence[Schema], universe: Universe
) -> Mapping[tuple[str, Signed], list[ConditionalChange]]:
    """For each operator and its arguments what it adds and deletes under which further
    conditions.
    """
    pairs = [
        (conditional, schema)
        for conditional in conditionals
        for schema in schemas
        if conditional.operator is schema.operator
    ]
    owners = {f"_effect_{number}": conditional for number, (conditional, _) in enumerate(pairs)}
    rules = {name: _conditional_rule(*pair, name) for name, pair in zip(owners, pairs, strict=True)}
    changes: dict[tuple[str, Signed], dict[ConditionalChange, None]] = {}
    for name, table in universe.tables(rules).items():
        owner = owners[name]
        width = len(owner.operator.variables)
        for row in table:
            change = (1 << row[-1], 0) if owner.effect.adds else (0, 1 << row[-1])
            entry = (signed_numbers(owner.literals, row[width:-1]), *change)
            changes.setdefault((owner.operator.name, tuple(row[:width])), {})[entry] = None
    return {key: list(entries) for key, entries in changes.items()}


def read_happenings(
    conditionals: Sequence[Conditional], schemas: Sequence[Schema], universe: Universe
) -> Mapping[tuple[str, Signed], list[tuple[Signed, Atom]]]:
    """For each operator and its arguments the events that happen under further conditions, with
    these.
    """
    pairs = [
        (conditional, schema)
        for conditional in conditionals
        for schema in schemas
        if conditional.operator is schema.operator
    ]
    owners = {f"_happens_{number}": conditional for number, (conditional, _) in enumerate(pairs)}
    rules = {name: _happening_rule(*pair, name) for name, pair in zip(owners, pairs, strict=True)}
    events: dict[tuple[str, Signed], dict[tuple[Signed, Atom], None]] = {}
    for name, table in universe.tables(rules).items() if rules else ():
        owner = owners[name]
        width, own = len(owner.operator.variables), _variables_of(owner)
        for row in table:
            terms = [universe.terms[number] for number in row[len(row) - len(own) :]]
            event = substitute_atom(owner.effect.atom, dict(zip(own, terms, strict=True)))
            entry = (signed_numbers(owner.literals, row[width : len(row) - len(own)]), event)
            events.setdefault((owner.operator.name, tuple(row[:width])), {})[entry] = None
    return {key: list(entries) for key, entries in events.items()}


def read_derivations(
    rules: Sequence[Rule], vocabulary: ChangingPredicates, universe: Universe
) -> dict[int, list[Signed]]:
    """For each derived atom the rule bodies that make it true."""
    texts, parts = {}, {}
    for number, derived in enumerate(rules):
        literals, static = vocabulary.split(derived.body)
        head, names = number_literals([Literal(derived.head)], "H")
        body, more = number_literals(literals, "B")
        name = f"_support_{number}"
        atom = Function(name, tuple(Variable(v) for v in (*names, *more)))
        texts[name] = (rule_text(str(atom), [*head, *body, *map(str, static)]), 1 + len(literals))
        parts[name] = literals
    bodies: dict[int, list[Signed]] = {}
    for name, table in universe.tables(texts).items():
        for row in table:
            bodies.setdefault(row[0], []).append(signed_numbers(parts[name], row[1:]))
    return bodies


def read_matches(
    conditions: Mapping[str, tuple[tuple[Literal, ...], Body]], universe: Universe
) -> dict[str, list[Signed]]:
    """For each named condition the ways to satisfy it.

    A condition consists of its dynamic literals and its static rest.
    """
    texts, parts = {}, {}
    for name, (literals, static) in conditions.items():
        body, names = number_literals(literals, "G")
        atom = Function(name, (*(Variable(v) for v in names), Function("0")))
        texts[name] = (rule_text(str(atom), [*body, *map(str, static)]), len(names) + 1)
        parts[name] = literals
    tables = universe.tables(texts)
    return {
        name: [signed_numbers(parts[name], row[:-1]) for row in table]
        for name, table in tables.items()
    }


def _plain_changes(
    schema: Schema, vocabulary: ChangingPredicates
) -> tuple[list[Effect], list[Effect]]:
    plain = [
        e
        for e in schema.operator.effects
        if not is_conditional(e) and e.atom.name in vocabulary.fluents
    ]
    return [e for e in plain if e.adds], [e for e in plain if not e.adds]


def _row_rule(schema: Schema, vocabulary: ChangingPredicates) -> tuple[str, int]:
    arguments = [column_name("A", i) for i, _ in enumerate(schema.operator.variables)]
    body = [
        instance_text(schema),
        *(f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)),
    ]
    adds, deletes = _plain_changes(schema, vocabulary)
    parts, names = number_literals(schema.literals, "P")
    added, add_names = number_literals([Literal(e.atom) for e in adds], "E")
    needed = {
        literal.atom: name
        for literal, name in zip(schema.literals, names, strict=True)
        if literal.positive
    }
    unknown = [Literal(e.atom, False) for e in deletes if e.atom not in needed]
    removed, delete_names = number_literals(unknown, "D")
    needed |= {literal.atom: name for literal, name in zip(unknown, delete_names, strict=True)}
    columns = [*arguments, *names, *add_names, *(needed[effect.atom] for effect in deletes)]
    head = Function(f"_row_{schema.number}", tuple(map(Variable, columns)))
    return rule_text(str(head), [*body, *parts, *added, *removed]), len(columns)


def _variables_of(conditional: Conditional) -> list[Variable]:
    return list(dict.fromkeys(term_variables(conditional.effect.atom)))


def happening_terms(conditional: Conditional, schema: Schema) -> Iterator[str]:
    """Rules that collect the terms in the events of a conditional effect, for
    `Universe.name_terms`.
    """
    for variable in _variables_of(conditional):
        yield rule_text(f"_arg({variable})", conditional_body(conditional, schema))


def _happening_rule(conditional: Conditional, schema: Schema, name: str) -> tuple[str, int]:
    arguments = [column_name("A", i) for i, _ in enumerate(schema.operator.variables)]
    own = [column_name("V", i) for i, _ in enumerate(_variables_of(conditional))]
    pairs = [*zip(schema.operator.variables, arguments, strict=True)]
    pairs += zip(_variables_of(conditional), own, strict=True)
    parts, names = number_literals(conditional.literals, "P")
    columns = [*arguments, *names, *own]
    body = [*conditional_body(conditional, schema), *(f"_a({v},{a})" for v, a in pairs), *parts]
    return rule_text(str(Function(name, tuple(map(Variable, columns)))), body), len(columns)


def _conditional_rule(conditional: Conditional, schema: Schema, name: str) -> tuple[str, int]:
    arguments = [column_name("A", i) for i, _ in enumerate(schema.operator.variables)]
    named = [f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)]
    parts, names = number_literals(conditional.literals, "P")
    changed, change_names = number_literals([Literal(conditional.effect.atom)], "E")
    columns = [*arguments, *names, *change_names]
    body = [*conditional_body(conditional, schema), *named, *parts, *changed]
    return rule_text(str(Function(name, tuple(map(Variable, columns)))), body), len(columns)
