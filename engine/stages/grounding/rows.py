"""Rows of numbers from clingo: the instances of operators, conditional effects, derived rules and goals.

A signed number n means "atom n is true", ~n means "atom n is false".
"""

from collections.abc import Iterator, Mapping, Sequence

from cellwright.engine.model.task import Bits
from cellwright.engine.stages.grounding.instances import InstanceRows
from cellwright.engine.stages.grounding.program import (
    Conditional,
    Schema,
    Vocabulary,
    column,
    conditional_body,
    instance,
    is_conditional,
    number_literals,
    rule,
    signed,
)
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain import Effect, Rule
from cellwright.kb.terms import Atom, Function, Variable, substitute_atom, variables

Signed = tuple[int, ...]
ConditionalChange = tuple[Signed, Bits, Bits]  # (conditions, adds, deletes)


def instances(
    schemas: Sequence[Schema], vocabulary: Vocabulary, universe: Universe
) -> Iterator[InstanceRows]:
    """Every reachable instance of every schema."""
    tables = universe.tables({f"_row_{schema.number}": _row_rule(schema, vocabulary) for schema in schemas})
    for schema in schemas:
        adds, _ = _changes(schema, vocabulary)
        yield InstanceRows(schema, tables.pop(f"_row_{schema.number}"), len(adds))


def conditional_changes(
    conditionals: Sequence[Conditional], schemas: Sequence[Schema], universe: Universe
) -> Mapping[tuple[str, Signed], list[ConditionalChange]]:
    """For each operator and its arguments what it adds and deletes under which further conditions."""
    pairs = [
        (each, schema) for each in conditionals for schema in schemas if each.operator is schema.operator
    ]
    owners = {f"_effect_{number}": each for number, (each, _) in enumerate(pairs)}
    rules = {name: _conditional_rule(*pair, name) for name, pair in zip(owners, pairs, strict=True)}
    found: dict[tuple[str, Signed], dict[ConditionalChange, None]] = {}
    for name, table in universe.tables(rules).items():
        each = owners[name]
        width = len(each.operator.variables)
        for row in table:
            change = (1 << row[-1], 0) if each.effect.adds else (0, 1 << row[-1])
            entry = (signed(each.literals, row[width:-1]), *change)
            found.setdefault((each.operator.name, tuple(row[:width])), {})[entry] = None
    return {key: list(entries) for key, entries in found.items()}


def happenings(
    conditionals: Sequence[Conditional], schemas: Sequence[Schema], universe: Universe
) -> Mapping[tuple[str, Signed], list[tuple[Signed, Atom]]]:
    """For each operator and its arguments the events that happen under further conditions, with these."""
    pairs = [
        (each, schema) for each in conditionals for schema in schemas if each.operator is schema.operator
    ]
    owners = {f"_happens_{number}": each for number, (each, _) in enumerate(pairs)}
    rules = {name: _happening_rule(*pair, name) for name, pair in zip(owners, pairs, strict=True)}
    found: dict[tuple[str, Signed], dict[tuple[Signed, Atom], None]] = {}
    for name, table in universe.tables(rules).items() if rules else ():
        each = owners[name]
        width, own = len(each.operator.variables), _variables_of(each)
        for row in table:
            terms = [universe.terms[number] for number in row[len(row) - len(own) :]]
            event = substitute_atom(each.effect.atom, dict(zip(own, terms, strict=True)))
            entry = (signed(each.literals, row[width : len(row) - len(own)]), event)
            found.setdefault((each.operator.name, tuple(row[:width])), {})[entry] = None
    return {key: list(entries) for key, entries in found.items()}


def derivations(rules: Sequence[Rule], vocabulary: Vocabulary, universe: Universe) -> dict[int, list[Signed]]:
    """For each derived atom the rule bodies that make it true."""
    texts, parts = {}, {}
    for number, each in enumerate(rules):
        literals, static = vocabulary.split(each.body)
        head, names = number_literals([Literal(each.head)], "H")
        body, more = number_literals(literals, "B")
        name = f"_support_{number}"
        atom = Function(name, tuple(Variable(v) for v in (*names, *more)))
        texts[name] = (rule(str(atom), [*head, *body, *map(str, static)]), 1 + len(literals))
        parts[name] = literals
    bodies: dict[int, list[Signed]] = {}
    for name, table in universe.tables(texts).items():
        for row in table:
            bodies.setdefault(row[0], []).append(signed(parts[name], row[1:]))
    return bodies


def matches(
    conditions: Mapping[str, tuple[tuple[Literal, ...], Body]], universe: Universe
) -> dict[str, list[Signed]]:
    """For each named condition the ways to satisfy it.

    A condition consists of its dynamic literals and its static rest.
    """
    texts, parts = {}, {}
    for name, (literals, static) in conditions.items():
        body, names = number_literals(literals, "G")
        atom = Function(name, (*(Variable(v) for v in names), Function("0")))
        texts[name] = (rule(str(atom), [*body, *map(str, static)]), len(names) + 1)
        parts[name] = literals
    tables = universe.tables(texts)
    return {name: [signed(parts[name], row[:-1]) for row in table] for name, table in tables.items()}


def _changes(schema: Schema, vocabulary: Vocabulary) -> tuple[list[Effect], list[Effect]]:
    plain = [
        e for e in schema.operator.effects if not is_conditional(e) and e.atom.name in vocabulary.fluents
    ]
    return [e for e in plain if e.adds], [e for e in plain if not e.adds]


def _row_rule(schema: Schema, vocabulary: Vocabulary) -> tuple[str, int]:
    arguments = [column("A", i) for i, _ in enumerate(schema.operator.variables)]
    body = [
        instance(schema),
        *(f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)),
    ]
    adds, deletes = _changes(schema, vocabulary)
    parts, names = number_literals(schema.literals, "P")
    added, add_names = number_literals([Literal(e.atom) for e in adds], "E")
    needed = {each.atom: name for each, name in zip(schema.literals, names, strict=True) if each.positive}
    unknown = [Literal(e.atom, False) for e in deletes if e.atom not in needed]
    removed, delete_names = number_literals(unknown, "D")
    needed |= {each.atom: name for each, name in zip(unknown, delete_names, strict=True)}
    columns = [*arguments, *names, *add_names, *(needed[each.atom] for each in deletes)]
    head = Function(f"_row_{schema.number}", tuple(map(Variable, columns)))
    return rule(str(head), [*body, *parts, *added, *removed]), len(columns)


def _variables_of(each: Conditional) -> list[Variable]:
    return list(dict.fromkeys(variables(each.effect.atom)))


def happening_terms(each: Conditional, schema: Schema) -> Iterator[str]:
    """Rules that collect the terms in the events of a conditional effect, for `Universe.name_terms`."""
    for variable in _variables_of(each):
        yield rule(f"_arg({variable})", conditional_body(each, schema))


def _happening_rule(each: Conditional, schema: Schema, name: str) -> tuple[str, int]:
    arguments = [column("A", i) for i, _ in enumerate(schema.operator.variables)]
    own = [column("V", i) for i, _ in enumerate(_variables_of(each))]
    pairs = [*zip(schema.operator.variables, arguments, strict=True)]
    pairs += zip(_variables_of(each), own, strict=True)
    parts, names = number_literals(each.literals, "P")
    columns = [*arguments, *names, *own]
    body = [*conditional_body(each, schema), *(f"_a({v},{a})" for v, a in pairs), *parts]
    return rule(str(Function(name, tuple(map(Variable, columns)))), body), len(columns)


def _conditional_rule(each: Conditional, schema: Schema, name: str) -> tuple[str, int]:
    arguments = [column("A", i) for i, _ in enumerate(schema.operator.variables)]
    named = [f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)]
    parts, names = number_literals(each.literals, "P")
    changed, change_names = number_literals([Literal(each.effect.atom)], "E")
    columns = [*arguments, *names, *change_names]
    body = [*conditional_body(each, schema), *named, *parts, *changed]
    return rule(str(Function(name, tuple(map(Variable, columns)))), body), len(columns)
