"""What a problem could have been: facts, argument values, and numbers that turn a comparison.

A rule or an operator that compares a number of a fact with something else changes its answer where
the two are equal. So the other side is solved for the number, and evaluated with all other facts as
they are.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.pipelines.explanation.amendments import domain_facts, terms_within
from cellwright.engine.pipelines.explanation.number_kinds import NumberKinds, Place, numbers_in
from cellwright.engine.pipelines.explanation.parts_of_values import names, values
from cellwright.engine.pipelines.explanation.relaxed_program import (
    AUXILIARY_RULES,
    MISSED_PREDICATE,
    default_rule,
    relaxed_rules,
)
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    conditional_alternatives,
    is_conditional,
    precondition_schemas,
    reachable_literal,
)
from cellwright.kb.asp.rule_compiler import ReadBody, read_body
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    Comparison,
    Condition,
    Literal,
    goal_parts,
)
from cellwright.kb.model.domain_model import NUMERIC_TYPES, UNLISTED_TYPES, Kind
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.statement import Signature
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    match_term,
    substitute_atom,
    substitute_term,
    term_variables,
)

THRESHOLD_PREDICATE = "_threshold"
Renamed = Mapping[str, str]
"""For each predicate that changes, the predicate that holds what is reachable of it."""


def threshold_rules(
    texts: Iterable[str], opened: Iterable[Signature], renamed: Renamed
) -> Iterator[str]:
    """Rules for `_threshold(p, i, N)`: N may matter as argument i of predicate p, which is one
    of `opened`.
    """
    opened_predicates = set(opened)
    seen: set[str] = set()
    for body in map(read_body, texts):
        for literal in body.literals:
            if (literal.atom.name, len(literal.atom.arguments)) not in opened_predicates:
                continue
            for place, argument in enumerate(literal.atom.arguments):
                if isinstance(argument, Variable) and argument != ANYTHING:
                    for line in _for_argument(body, literal, place, argument, renamed):
                        if line not in seen:
                            seen.add(line)
                            yield line


def _for_argument(
    body: ReadBody, literal: Literal, place: int, argument: Variable, renamed: Renamed
) -> Iterator[str]:
    rest = [_atom_text(literal.atom, renamed) for literal in _other_literals(body, argument)]
    own = _atom_text(substitute_atom(literal.atom, {argument: ANYTHING}), renamed)
    bound = {v for literal in _other_literals(body, argument) for v in term_variables(literal.atom)}
    beside = {v for v in term_variables(literal.atom)} - {argument}
    rest += [text for variable, text in body.counted]
    bound |= {variable for variable, _ in body.counted}
    for value in _threshold_terms(body, argument):
        needed = set(term_variables(value))
        if not needed <= bound | beside:
            continue
        parts = rest if needed <= bound else [*rest, own]
        head = f"{THRESHOLD_PREDICATE}({literal.atom.name}, {place}, {value}+__D)"
        yield f"{head} :- {', '.join([*parts, '__D = -1..1'])}."


def _other_literals(body: ReadBody, argument: Variable) -> Iterator[Literal]:
    """The literals that hold whatever the number is."""
    return (
        literal
        for literal in body.literals
        if literal.positive and argument not in term_variables(literal.atom)
    )


def _atom_text(atom: Atom, renamed: Renamed) -> str:
    return str(Function(renamed.get(atom.name, atom.name), atom.arguments))


def _threshold_terms(body: ReadBody, argument: Variable) -> Iterator[Term]:
    """What the variable is compared with, once every comparison that has it on one side is
    solved for it.
    """
    for comparison in body.comparisons:
        for bindings in ({}, _equation_definitions(body, argument)):
            left, right = (
                substitute_term(comparison.left, bindings),
                substitute_term(comparison.right, bindings),
            )
            if list((*term_variables(left), *term_variables(right))).count(argument) == 1:
                inside, opposite = (
                    (left, right) if argument in term_variables(left) else (right, left)
                )
                if (solution := solve_for_variable(inside, opposite, argument)) is not None:
                    yield solution


def _equation_definitions(body: ReadBody, argument: Variable) -> dict[Variable, Term]:
    """The variables that an equation defines, without `argument`."""
    defined: dict[Variable, Term] = {}
    for comparison in body.comparisons:
        for left_term, right in (
            (comparison.left, comparison.right),
            (comparison.right, comparison.left),
        ):
            if (
                comparison.relation == "="
                and isinstance(left_term, Variable)
                and not isinstance(right, Variable)
            ):
                defined.setdefault(left_term, right)
    defined.pop(argument, None)
    return defined


def solve_for_variable(inside: Term, opposite: Term, unknown: Variable) -> Term | None:
    """The value of `wanted`, which occurs once in `inside`, for which `inside` equals `other`, up
    to rounding.

    None where it cannot be computed.
    """
    while isinstance(inside, Operation):
        is_left = unknown in term_variables(inside.left)
        rest = inside.right if is_left else inside.left
        if (sign := _INVERSE_OPERATORS.get((inside.operator, is_left))) is None:
            return None
        operator, swapped = sign
        opposite = (
            Operation(operator, rest, opposite) if swapped else Operation(operator, opposite, rest)
        )
        inside = inside.left if is_left else inside.right
    return opposite if inside == unknown else None


# (operator, wanted is on its left): operator of the solution, and whether the rest comes first
_INVERSE_OPERATORS = {
    ("+", True): ("-", False),
    ("+", False): ("-", False),
    ("-", True): ("+", False),
    ("-", False): ("-", True),
    ("*", True): ("/", False),
    ("*", False): ("/", False),
    ("/", True): ("*", False),
    ("/", False): ("/", True),
}


SMALL_NUMBER = 10  # numbers up to this one are tried wherever a number stands


@dataclass(frozen=True)
class ProblemSpace:
    """`problem` has the facts of its domain as statics of its own; `initial` is its whole
    initial state.
    """

    problem: Problem
    initial: tuple[Atom, ...]
    # statics that are the problem's, not the domain's
    own: frozenset[Atom] = field(default=frozenset())

    @classmethod
    def of(cls, problem: Problem, initial: tuple[Atom, ...]) -> "ProblemSpace":
        """The space of a problem."""
        facts = domain_facts(problem.domain)
        asp = tuple(rule for number, rule in enumerate(problem.domain.asp) if number not in facts)
        moved = tuple(atom for atoms in facts.values() for atom in atoms)
        statics = tuple(dict.fromkeys((*problem.statics, *moved)))
        opened = replace(problem, domain=replace(problem.domain, asp=asp), statics=statics)
        return cls(opened, initial, frozenset(problem.statics))

    @cached_property
    def atoms(self) -> dict[Signature, tuple[tuple[Term, ...], ...]]:
        """The true static atoms, and the reachable ones of the relaxed task, by predicate."""
        text = [f"{reachable_literal(atom)}." for atom in self.initial]
        text.append(relaxed_rules(self.problem))
        text += [
            default_rule(self.problem, number)
            for number, _ in enumerate(self.problem.domain.defaults)
        ]
        kinds = self.problem.domain.predicates
        renamed = {
            name: f"_r_{name}"
            for name, predicate in kinds.items()
            if predicate.kind in (Kind.FLUENT, Kind.DERIVED)
        }
        renamed |= {
            name: f"_h_{name}" for name, predicate in kinds.items() if predicate.kind is Kind.EVENT
        }
        text.append(f"#defined {THRESHOLD_PREDICATE}/3.")
        text += threshold_rules(self._bodies(), self._numeric(), renamed)
        grounder = evaluate_statics(self.problem, text)
        rows_by_signature: dict[Signature, list[tuple[Term, ...]]] = defaultdict(list)
        for atom in grounder.everything():
            rows_by_signature[(atom.name, len(atom.arguments))].append(atom.arguments)
        return {signature: tuple(rows) for signature, rows in rows_by_signature.items()}

    @property
    def reachable(self) -> bool:
        """Whether every goal is within reach if nothing is ever denied."""
        return not self.atoms.get((MISSED_PREDICATE, 1))

    def rows(self, signature: Signature) -> tuple[tuple[Term, ...], ...]:
        """The argument tuples of the true atoms of a predicate."""
        return self.atoms.get(signature, ())

    def misses(self, atom: Atom) -> bool:
        """Whether a fluent or event is out of reach, even if nothing is ever denied."""
        declared = self.problem.domain.predicates.get(atom.name)
        if declared is None or declared.kind not in (Kind.FLUENT, Kind.EVENT):
            return False
        name = f"{'_h' if declared.kind is Kind.EVENT else '_r'}_{atom.name}"
        rows = self.rows((name, len(atom.arguments)))
        return all(match_term(atom, Function(atom.name, row), {}) is None for row in rows)

    @cached_property
    def statics(self) -> tuple[Signature, ...]:
        """The static predicates that could have other facts and matter to anything."""
        declared = [
            (predicate.name, len(predicate.arguments))
            for predicate in self.problem.domain.predicates.values()
            if predicate.kind is Kind.STATIC
        ]
        given_signatures = [(fact.name, len(fact.arguments)) for fact in self.problem.statics]
        return tuple(
            signature
            for signature in dict.fromkeys((*declared, *given_signatures))
            if signature[0] in self.used
        )

    @cached_property
    def computed(self) -> frozenset[str]:
        """The names of static predicates that rules define."""
        return frozenset(
            rule.defines[0] for rule in self.problem.domain.asp if rule.defines and rule.body
        )

    @cached_property
    def given(self) -> frozenset[str]:
        """The names of static predicates that have facts which nobody computes."""
        return frozenset(fact.name for fact in self.problem.statics)

    @cached_property
    def size(self) -> int:
        """How many instances of operators the relaxed task has."""
        return sum(len(self.rows(signature)) for signature in self.instances)

    @cached_property
    def instances(self) -> tuple[Signature, ...]:
        """The predicates of the relaxed task that hold instances of operators."""
        normaliser = Normaliser()
        vocabulary = ChangingPredicates(self.problem.domain)
        schemas_of_domain = precondition_schemas(self.problem.domain, normaliser, vocabulary)
        return tuple((f"_o_{schema.number}", len(schema.variables)) for schema in schemas_of_domain)

    @cached_property
    def shared(self) -> tuple[Signature, ...]:
        """The static predicates and types by which a problem differs apart from instances of
        operators.

        They decide what follows from a step, what a derived predicate or a goal means, and which
        defaults apply.
        """
        domain, normaliser = self.problem.domain, Normaliser()
        vocabulary = ChangingPredicates(domain)
        list(precondition_schemas(domain, normaliser, vocabulary))
        effects = [
            effect
            for operator in domain.operators
            for effect in operator.effects
            if is_conditional(effect)
        ]
        list(conditional_alternatives(domain, normaliser, vocabulary))
        parts = (
            domain.deductive_operators,
            domain.defaults,
            domain.rules,
            self.problem.goal,
            tuple(effects),
        )
        names_used = {name for part in (*parts, tuple(normaliser.rules)) for name in names(part)}
        changing = {
            predicate.name
            for predicate in domain.predicates.values()
            if predicate.kind is not Kind.STATIC
        }
        candidates = {*self.atoms, *self.statics, *((name, 1) for name in domain.types)}
        return tuple(
            sorted(signature for signature in candidates if signature[0] in names_used - changing)
        )

    @cached_property
    def denying(self) -> frozenset[str]:
        """The static predicates that decide whether a fact denies another one, such as a
        default.
        """
        bodies = [
            (*operator.body, *consequence.body, operator.parameters)
            for operator in self.problem.domain.deductive_operators
            for consequence in operator.consequences
            if operator.trigger.positive and not consequence.implied
        ]
        names_read = {name for body in bodies for name in names(body)}
        while True:
            rules = [
                rule
                for rule in self.problem.domain.asp
                if rule.defines and rule.defines[0] in names_read
            ]
            more = names_read | {use.predicate[0] for rule in rules for use in rule.uses}
            if more == names_read:
                return frozenset(names_read)
            names_read = more

    @cached_property
    def dangling(self) -> tuple[str, ...]:
        """Names that facts, goals and stages mention and that no object has."""
        atoms = (*self.problem.statics, *self.problem.initial)
        terms = {
            inner
            for atom in (
                *atoms,
                *(stage for chain in self.problem.chains for stage in chain.stages),
            )
            for argument in atom.arguments
            for inner in terms_within(argument)
        }
        named = {
            str(constant)
            for constant in terms
            if isinstance(constant, Function) and not constant.arguments
        }
        named |= set(names(self.problem.goal))
        domain = self.problem.domain
        declared = {
            *domain.objects,
            *self.problem.objects,
            *domain.predicates,
            *domain.functions,
            *domain.types,
        }
        return tuple(sorted(named.difference(declared, UNLISTED_TYPES)))

    @cached_property
    def used(self) -> frozenset[str]:
        """The names that anything but a fact mentions."""
        domain = self.problem.domain
        parts = (
            domain.operators,
            domain.deductive_operators,
            domain.defaults,
            domain.rules,
            self.problem.goal,
        )
        read = {use.predicate[0] for rule in self.problem.domain.asp for use in rule.uses}
        return frozenset(read | {name for part in parts for name in names(part)})

    def arguments(self, signature: Signature) -> tuple[tuple[Term, ...], ...]:
        """The values that each argument of a predicate could take."""
        predicate = self.problem.domain.predicates.get(signature[0])
        if predicate is None:
            return tuple(self._beside(signature, place) for place in range(signature[1]))
        return tuple(
            self._values(signature, place, type_) for place, type_ in enumerate(predicate.arguments)
        )

    def _values(self, signature: Signature, place: int, type_: str) -> tuple[Term, ...]:
        if type_ in NUMERIC_TYPES:
            return tuple(map(Number, self._numbers(signature, place)))
        if type_ == "text":
            return tuple(
                sorted({term for term in self._mentioned if isinstance(term, Text)}, key=str)
            )
        return tuple(sorted((row[0] for row in self.rows((type_, 1))), key=str))

    def _beside(self, signature: Signature, place: int) -> tuple[Term, ...]:
        """For a predicate without declaration: values like those that it has at this place."""
        values = {fact.arguments[place] for fact in self._given(signature)}
        objects = {**self.problem.domain.objects, **self.problem.objects}
        types = {objects[str(neighbour)] for neighbour in values if str(neighbour) in objects}
        values |= {Function(name) for name, type_ in objects.items() if type_ in types}
        if any(isinstance(neighbour, Number) for neighbour in values):
            values |= set(map(Number, self._numbers(signature, place)))
        return tuple(sorted(values, key=str))

    def _given(self, signature: Signature) -> Iterator[Atom]:
        facts = (*self.problem.statics, *self.problem.initial)
        return (fact for fact in facts if (fact.name, len(fact.arguments)) == signature)

    def _numbers(self, signature: Signature, place: int) -> list[int]:
        """Small numbers, those of the same kind that anything mentions, how many objects there are,
        and those beside which a comparison changes.
        """
        own = {fact.arguments[place] for fact in self._given(signature)}
        alike = self._kinds.alike(Place(signature[0], place))
        numbers = {number for term in alike for number in self._numbers_at.get(term, ())}
        numbers |= {
            term.value + step for term in own if isinstance(term, Number) for step in (-1, 1)
        }
        numbers |= self._object_counts
        compared = (Function(signature[0]), Number(place))
        numbers |= {
            row[2].value
            for row in self.rows((THRESHOLD_PREDICATE, 3))
            if row[:2] == compared and isinstance(row[2], Number)
        }
        if signature[0] in self.problem.domain.quantities:
            numbers |= {number + step for number in self._compared for step in (-1, 0, 1)}
        return sorted(numbers | set(range(SMALL_NUMBER + 1)))

    @cached_property
    def _kinds(self) -> NumberKinds:
        return NumberKinds(self.problem.domain)

    @cached_property
    def _numbers_at(self) -> dict[Place, set[int]]:
        """The numbers that a fact, a reachable atom, a stage or the goal has at each place."""
        found: dict[Place, set[int]] = defaultdict(set)
        atoms = (
            Function(name.removeprefix("_r_").removeprefix("_h_").removeprefix("_v_"), row)
            for (name, _), rows in self._held()
            for row in rows
        )
        asked = (each for each in values(self.problem.goal) if isinstance(each, Function))
        for atom in (*atoms, *asked):
            for place, number in numbers_in(atom):
                found[place].add(number)
        return found

    @cached_property
    def _object_counts(self) -> frozenset[int]:
        """How many objects each type has: something may have to be enough for all of them."""
        types = self.problem.domain.types
        return frozenset(
            len(self.rows((name, 1))) for name, each in types.items() if not each.constants
        )

    def _held(self) -> Iterator[tuple[Signature, tuple[tuple[Term, ...], ...]]]:
        """The true and the reachable atoms, without what only explains them."""
        hidden = ("_o_", MISSED_PREDICATE, "_goal", *AUXILIARY_RULES)
        return (
            each
            for each in self.atoms.items()
            if each[0][0] != THRESHOLD_PREDICATE and not each[0][0].startswith(hidden)
        )

    @cached_property
    def _compared(self) -> frozenset[int]:
        """The numbers in goals and conditions of operators: with values beside them, a quantity
        may be enough.
        """
        conditions = (
            self.problem.goal,
            *(operator.precondition for operator in self.problem.domain.operators),
        )
        inner_values = (
            inner_value for condition in conditions for inner_value in values(condition)
        )
        return frozenset(number.value for number in inner_values if isinstance(number, Number))

    @cached_property
    def _mentioned(self) -> frozenset[Term]:
        """Every number and text in a fact, a reachable atom or a stage."""
        mentioned = (row for _, rows in self._held() for row in rows)
        terms = (inner for row in mentioned for argument in row for inner in terms_within(argument))
        return frozenset(term for term in terms if isinstance(term, Number | Text))

    def _bodies(self) -> Iterator[str]:
        """Every body over statics, as ASP text."""
        domain = self.problem.domain
        yield from (", ".join(rule.body) for rule in domain.asp if rule.body)
        parts = [
            *(rule.body for rule in domain.rules),
            *(default.body for default in domain.defaults),
        ]
        parts += [
            (*operator.body, *_plain_body(operator.precondition)) for operator in domain.operators
        ]
        for deductive in domain.deductive_operators:
            parts += [
                (*deductive.body, *consequence.body) for consequence in deductive.consequences
            ]
        yield from (", ".join(map(str, body)) for body in parts if body)

    def _numeric(self) -> list[Signature]:
        declared = {
            (predicate.name, len(predicate.arguments))
            for predicate in self.problem.domain.predicates.values()
            if set(predicate.arguments) & set(NUMERIC_TYPES)
        }
        return sorted(
            declared | {(fact.name, len(fact.arguments)) for fact in self.problem.statics}
        )


def _plain_body(condition: Condition) -> Body:
    """The conjuncts of a condition that are literals, comparisons or aggregates."""
    return tuple(
        part for part in goal_parts(condition) if isinstance(part, Literal | Comparison | Aggregate)
    )
