"""From a problem to a ground task: clingo finds what can be reached, numbers come back, Python makes bitsets."""

from collections.abc import Iterator
from dataclasses import dataclass

from engine.grounding.closure import Deduction, deduction
from engine.grounding.derived import Supports
from engine.grounding.instances import Instances, Numbering, Row, complemented
from engine.grounding.invariants import mutex_groups
from engine.grounding.normalise import Normaliser
from engine.grounding.program import (
    Conditional,
    Schema,
    Vocabulary,
    conditional_body,
    conditionals,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance,
    instance_rule,
    is_conditional,
    number_literals,
    reachable,
    rule,
    schemas,
)
from engine.grounding.universe import DERIVED, Universe
from engine.grounding.weights import weights
from engine.grounding.workflow import Workflow
from engine.model.task import Bits, GroundOperator, Task, bitset, indices
from kb.asp import Grounder
from kb.asp.vocabulary import guard, static_program
from kb.diagnostics import Diagnostic, InvalidInput
from kb.model.conditions import Literal
from kb.model.domain import Effect
from kb.model.problem import Problem
from kb.terms import Function, Variable


def ground(problem: Problem) -> Task:
    """The ground task of a problem. Raises `InvalidInput` for contradictions among deductive operators."""
    return _Grounding(problem).task()


class _Grounding:
    """The stages of one grounding, each using what the ones before it found."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.domain = problem, problem.domain
        self.normaliser = Normaliser()
        self.vocabulary = Vocabulary(self.domain)
        self.schemas = list(schemas(self.domain, self.normaliser, self.vocabulary))
        self.conditionals = list(conditionals(self.domain, self.normaliser, self.vocabulary))
        self.goals = self.normaliser.disjuncts(problem.goal, {})
        self.rules = [*self.domain.rules, *self.normaliser.rules]
        self.vocabulary = Vocabulary(self.domain, self.normaliser.rules)
        self.invented = {r.head.name: len(r.head.arguments) for r in self.normaliser.rules}
        self.static = static_program(problem)

    def task(self) -> Task:
        initial = self._initial()
        universe = self._reachable(initial)
        effects = deduction(self.domain, self.vocabulary, universe)
        supports = self._supports(universe)
        workflow = Workflow(self.problem.chains, universe, len(universe.atoms), self.vocabulary.events)
        numbering = Numbering(len(universe.atoms) + len(workflow.atoms))
        made = Instances(universe, effects, supports, workflow, numbering, self._conditional_rows(universe))
        operators = dict.fromkeys(o for row in self._rows(universe) for o in made.operators(row))
        if made.contradictions:
            raise InvalidInput(contradictions(made, universe))
        goals = self._goals(universe, supports, numbering)
        return self._assembled(initial, universe, workflow, numbering, list(operators), goals)

    def _assembled(
        self,
        initial: tuple[Function, ...],
        universe: Universe,
        workflow: Workflow,
        numbering: Numbering,
        operators: list[GroundOperator],
        goals: list[Bits],
    ) -> Task:
        start = bitset([universe.index[atom] for atom in initial])
        complements = bitset([c for atom, c in numbering.complements.items() if not start >> atom & 1])
        first = start | workflow.initial | complements
        negated = (Function("not", (universe.atoms[atom],)) for atom in numbering.complements)
        atoms = (*universe.atoms, *workflow.atoms, *negated)
        completed = tuple(complemented(operator, numbering) for operator in operators)
        groups = mutex_groups(atoms, completed, first)
        pairs = tuple(1 << atom | 1 << complement for atom, complement in numbering.complements.items())
        return Task(
            atoms,
            completed,
            first,
            tuple(goal | workflow.goal for goal in goals),
            weights(self.domain, atoms, completed),
            tuple(dict.fromkeys((*groups, *pairs))),
        )

    def _initial(self) -> tuple[Function, ...]:
        """The initial state: given facts closed, then the defaults that nothing contradicts, one by one."""
        if self.problem.complete:
            return tuple(dict.fromkeys(self.problem.initial))
        grounder = Grounder()
        text = [self.static, *(f"{reachable(fact)}." for fact in self.problem.initial)]
        for number, default in enumerate(self.domain.defaults):
            body = [*guard(default.parameters), *map(str, default.body)]
            text.append(rule(str(Function(f"_d_{number}", default.atom.arguments)), body))
            text.append(rule(reachable(default.atom), body))
        text += [r for operator in self.domain.deductive_operators for r in deduction_rules(operator)]
        grounder.ground("\n".join(text))
        universe = Universe(grounder, self.vocabulary, self.invented)
        state = _InitialState(deduction(self.domain, self.vocabulary, universe))
        state.give(bitset([universe.index[fact] for fact in self.problem.initial]))
        if state.facts & state.denied:
            names = [str(universe.atoms[i]) for i in indices(state.facts & state.denied)]
            raise InvalidInput(
                [Diagnostic(self.problem.where, "K301", f"the initial facts deny {', '.join(names)}")]
            )
        for number, default in enumerate(self.domain.defaults):
            found = grounder.atoms(f"_d_{number}", len(default.atom.arguments))
            for atom in sorted((Function(default.atom.name, arguments) for arguments in found), key=str):
                state.suppose(universe.index[atom])
        return tuple(universe.atoms[index] for index in indices(state.facts))

    def _reachable(self, initial: tuple[Function, ...]) -> Universe:
        grounder = Grounder()
        text = [self.static, *(f"{reachable(atom)}." for atom in initial)]
        for chain in self.problem.chains:
            text += [
                f"_v_{s.name}({', '.join(map(str, s.arguments))})."
                for s in chain.stages
                if s.name in self.vocabulary.events
            ]
        for schema in self.schemas:
            text += [instance_rule(schema, self.vocabulary), *effect_rules(schema, self.vocabulary)]
            text += self._conditional_rules(schema)
        text += [derived_rule(each, self.vocabulary) for each in self.rules]
        text += [r for operator in self.domain.deductive_operators for r in deduction_rules(operator)]
        grounder.ground("\n".join(text))
        universe = Universe(grounder, self.vocabulary, self.invented)
        universe.name_terms(
            rule(f"_arg({v})", [instance(s)]) for s in self.schemas for v in s.operator.variables
        )
        return universe

    def _conditional_rules(self, schema: Schema) -> Iterator[str]:
        for each in self.conditionals:
            if each.operator is schema.operator and each.effect.adds:
                yield rule(reachable(each.effect.atom), conditional_body(each, schema))

    def _rows(self, universe: Universe) -> Iterator[Row]:
        rules = {f"_row_{schema.number}": _row_rule(schema, self.vocabulary) for schema in self.schemas}
        tables = universe.tables(rules)
        for schema in self.schemas:
            width, literals = len(schema.operator.variables), schema.literals
            adds, deletes = _changes(schema, self.vocabulary)
            for row in tables[f"_row_{schema.number}"].tolist():
                conditions = _signed(literals, row[width : width + len(literals)])
                if conditions is None:
                    continue
                changed = row[width + len(literals) :]
                added = bitset(changed[: len(adds)])
                removed = bitset([atom for atom in changed[len(adds) :] if atom >= 0])
                yield Row(schema, tuple(row[:width]), conditions, added, removed)

    def _conditional_rows(
        self, universe: Universe
    ) -> dict[tuple[str, tuple[int, ...]], list[tuple[tuple[int, ...], Bits, Bits]]]:
        rules, owners = {}, {}
        for number, (each, schema) in enumerate(
            (c, s) for c in self.conditionals for s in self.schemas if c.operator is s.operator
        ):
            rules[f"_effect_{number}"] = _conditional_rule(each, schema, f"_effect_{number}")
            owners[f"_effect_{number}"] = each
        found: dict[tuple[str, tuple[int, ...]], list[tuple[tuple[int, ...], Bits, Bits]]] = {}
        for name, table in universe.tables(rules).items():
            each = owners[name]
            width = len(each.operator.variables)
            for row in table.tolist():
                conditions = _signed(each.literals, row[width:-1])
                if conditions is not None:
                    change = (1 << row[-1], 0) if each.effect.adds else (0, 1 << row[-1])
                    entry = (conditions, *change)
                    entries = found.setdefault((each.operator.name, tuple(row[:width])), [])
                    if entry not in entries:
                        entries.append(entry)
        return found

    def _supports(self, universe: Universe) -> Supports:
        texts: dict[str, tuple[str, int]] = {}
        parts = {}
        for number, each in enumerate(self.rules):
            literals, static = self.vocabulary.split(each.body)
            head, names = number_literals([Literal(each.head)], "H")
            body, more = number_literals(literals, "B")
            name = f"_support_{number}"
            atom = Function(name, tuple(Variable(v) for v in (*names, *more)))
            texts[name] = (rule(str(atom), [*head, *body, *map(str, static)]), 1 + len(literals))
            parts[name] = literals
        bodies: dict[int, list[tuple[int, ...]]] = {}
        for name, table in universe.tables(texts).items():
            for row in table.tolist():
                conditions = _signed(parts[name], row[1:])
                if conditions is not None:
                    bodies.setdefault(row[0], []).append(conditions)
        return Supports(range(DERIVED, DERIVED + len(universe.derived)), bodies)

    def _goals(self, universe: Universe, supports: Supports, numbering: Numbering) -> list[Bits]:
        texts: dict[str, tuple[str, int]] = {}
        parts = {}
        for number, disjunct in enumerate(self.goals):
            literals, static = self.vocabulary.split(disjunct)
            body, names = number_literals(literals, "G")
            name = f"_goal_{number}"
            atom = Function(name, (*(Variable(v) for v in names), Function("0")))
            texts[name] = (rule(str(atom), [*body, *map(str, static)]), len(names) + 1)
            parts[name] = literals
        found: dict[Bits, None] = {}
        for name, table in universe.tables(texts).items():
            for row in table.tolist():
                conditions = _signed(parts[name], row[:-1])
                if conditions is not None:
                    found.update(
                        (numbering.bits(support), None) for support in supports.combinations(conditions)
                    )
        return list(found)


class _InitialState:
    """Facts and what they deny, growing (language reference, Meaning 6)."""

    def __init__(self, deduced: Deduction) -> None:
        self.deduced = deduced
        self.facts = self.denied = 0

    def give(self, facts: Bits) -> None:
        self.facts, self.denied = self.deduced.close(facts, facts)

    def suppose(self, atom: int) -> None:
        added, denied = self.deduced.close(1 << atom, self.facts)
        if not (added & self.denied or denied & self.facts or added & denied):
            self.facts |= added
            self.denied |= denied


def contradictions(made: Instances, universe: Universe) -> Iterator[Diagnostic]:
    """One diagnostic per operator whose consequences contradict each other (Meaning 4)."""
    for operator, found in {each.operator.name: each for each in reversed(made.contradictions)}.items():
        atom = universe.atoms[next(indices(found.atoms))]
        chain = _chain(made.deduction, universe, found.adds, atom)
        message = f"{found.instance} both adds and denies {atom}: {chain}"
        yield Diagnostic(
            found.operator.where, "K301", message, f"narrow the deductive operators behind {operator}"
        )


def _chain(deduced: Deduction, universe: Universe, adds: Bits, atom: Function) -> str:
    bit = 1 << universe.index[atom]
    adder = next((i for i in indices(adds) if deduced.implied[i] & bit), None)
    denier = next((i for i in indices(adds) if deduced.denied[i] & bit), None)
    said = [
        f"{universe.atoms[i]} {verb} it"
        for i, verb in ((adder, "adds or implies"), (denier, "denies"))
        if i is not None
    ]
    return ", ".join(said) or "by way of what it denies"


def _signed(literals: tuple[Literal, ...], numbers: list[int]) -> tuple[int, ...] | None:
    """Signed numbers of a row's literals; a negated atom that is never reachable is no condition (number -1)."""
    return tuple(
        number if literal.positive else ~number
        for literal, number in zip(literals, numbers, strict=True)
        if literal.positive or number >= 0
    )


def _changes(schema: Schema, vocabulary: Vocabulary) -> tuple[list[Effect], list[Effect]]:
    plain = [
        e for e in schema.operator.effects if not is_conditional(e) and e.atom.name in vocabulary.fluents
    ]
    return [e for e in plain if e.adds], [e for e in plain if not e.adds]


def _row_rule(schema: Schema, vocabulary: Vocabulary) -> tuple[str, int]:
    arguments = [f"A{i}__" for i, _ in enumerate(schema.operator.variables)]
    body = [
        instance(schema),
        *(f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)),
    ]
    adds, deletes = _changes(schema, vocabulary)
    parts, names = number_literals(schema.literals, "P")
    added, add_names = number_literals([Literal(e.atom) for e in adds], "E")
    removed, delete_names = number_literals([Literal(e.atom, False) for e in deletes], "D")
    columns = [*arguments, *names, *add_names, *delete_names]
    head = Function(f"_row_{schema.number}", tuple(map(Variable, columns)))
    return rule(str(head), [*body, *parts, *added, *removed]), len(columns)


def _conditional_rule(each: Conditional, schema: Schema, name: str) -> tuple[str, int]:
    arguments = [f"A{i}__" for i, _ in enumerate(schema.operator.variables)]
    named = [f"_a({v},{a})" for v, a in zip(schema.operator.variables, arguments, strict=True)]
    parts, names = number_literals(each.literals, "P")
    changed, change_names = number_literals([Literal(each.effect.atom)], "E")
    columns = [*arguments, *names, *change_names]
    body = [*conditional_body(each, schema), *named, *parts, *changed]
    return rule(str(Function(name, tuple(map(Variable, columns)))), body), len(columns)
