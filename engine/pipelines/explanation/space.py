"""What a problem could have been: its facts one by one, the values that arguments can take, what is true of it at most."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property

from cellwright.engine.pipelines.explanation.amendments import domain_facts, subterms
from cellwright.engine.pipelines.explanation.measures import AUXILIARY
from cellwright.engine.pipelines.explanation.relaxation import MISSED, default_rule, relaxed_rules
from cellwright.engine.pipelines.explanation.thresholds import THRESHOLD, threshold_rules
from cellwright.engine.stages.grounding.program import (
    Vocabulary,
    conditionals,
    is_conditional,
    reachable,
    schemas,
)
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    Comparison,
    Condition,
    Literal,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain import NUMERIC_TYPES, UNLISTED, Kind
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.statement import Signature
from cellwright.kb.terms import Atom, Function, Number, Term, Text, match

SMALL = 10  # numbers up to this one are tried wherever a number stands


@dataclass(frozen=True)
class Space:
    """`problem` has the facts of its domain as statics of its own; `initial` is its whole initial state."""

    problem: Problem
    initial: tuple[Atom, ...]
    own: frozenset[Atom] = field(default=frozenset())  # statics that are the problem's, not the domain's

    @classmethod
    def of(cls, problem: Problem, initial: tuple[Atom, ...]) -> "Space":
        """The space of a problem."""
        facts = domain_facts(problem.domain)
        asp = tuple(each for number, each in enumerate(problem.domain.asp) if number not in facts)
        moved = tuple(atom for atoms in facts.values() for atom in atoms)
        statics = tuple(dict.fromkeys((*problem.statics, *moved)))
        opened = replace(problem, domain=replace(problem.domain, asp=asp), statics=statics)
        return cls(opened, initial, frozenset(problem.statics))

    @cached_property
    def atoms(self) -> dict[Signature, tuple[tuple[Term, ...], ...]]:
        """The true static atoms, and the reachable ones of the relaxed task, by predicate."""
        text = [f"{reachable(atom)}." for atom in self.initial]
        text.append(relaxed_rules(self.problem))
        text += [default_rule(self.problem, number) for number, _ in enumerate(self.problem.domain.defaults)]
        kinds = self.problem.domain.predicates
        renamed = {
            name: f"_r_{name}" for name, each in kinds.items() if each.kind in (Kind.FLUENT, Kind.DERIVED)
        }
        renamed |= {name: f"_h_{name}" for name, each in kinds.items() if each.kind is Kind.EVENT}
        text.append(f"#defined {THRESHOLD}/3.")
        text += threshold_rules(self._bodies(), self._numeric(), renamed)
        grounder = evaluated(self.problem, text)
        found: dict[Signature, list[tuple[Term, ...]]] = defaultdict(list)
        for atom in grounder.everything():
            found[(atom.name, len(atom.arguments))].append(atom.arguments)
        return {signature: tuple(rows) for signature, rows in found.items()}

    @property
    def reachable(self) -> bool:
        """Whether every goal is within reach if nothing is ever denied."""
        return not self.atoms.get((MISSED, 1))

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
        return all(match(atom, Function(atom.name, row), {}) is None for row in rows)

    @cached_property
    def statics(self) -> tuple[Signature, ...]:
        """The static predicates that could have other facts and matter to anything."""
        declared = [
            (each.name, len(each.arguments))
            for each in self.problem.domain.predicates.values()
            if each.kind is Kind.STATIC
        ]
        given = [(each.name, len(each.arguments)) for each in self.problem.statics]
        return tuple(each for each in dict.fromkeys((*declared, *given)) if each[0] in self.used)

    @cached_property
    def computed(self) -> frozenset[str]:
        """The names of static predicates that rules define."""
        return frozenset(each.defines[0] for each in self.problem.domain.asp if each.defines and each.body)

    @cached_property
    def given(self) -> frozenset[str]:
        """The names of static predicates that have facts which nobody computes."""
        return frozenset(each.name for each in self.problem.statics)

    @cached_property
    def size(self) -> int:
        """How many instances of operators the relaxed task has."""
        return sum(len(self.rows(each)) for each in self.instances)

    @cached_property
    def instances(self) -> tuple[Signature, ...]:
        """The predicates of the relaxed task that hold instances of operators."""
        normaliser = Normaliser()
        vocabulary = Vocabulary(self.problem.domain)
        made = schemas(self.problem.domain, normaliser, vocabulary)
        return tuple((f"_o_{each.number}", len(each.variables)) for each in made)

    @cached_property
    def shared(self) -> tuple[Signature, ...]:
        """The static predicates and types by which a problem differs apart from instances of operators.

        They decide what follows from a step, what a derived predicate or a goal means, and which defaults apply.
        """
        domain, normaliser = self.problem.domain, Normaliser()
        vocabulary = Vocabulary(domain)
        list(schemas(domain, normaliser, vocabulary))
        effects = [
            effect for operator in domain.operators for effect in operator.effects if is_conditional(effect)
        ]
        list(conditionals(domain, normaliser, vocabulary))
        parts = (domain.deductive_operators, domain.defaults, domain.rules, self.problem.goal, tuple(effects))
        found = {name for part in (*parts, tuple(normaliser.rules)) for name in names(part)}
        changing = {each.name for each in domain.predicates.values() if each.kind is not Kind.STATIC}
        wanted = {*self.atoms, *self.statics, *((name, 1) for name in domain.types)}
        return tuple(sorted(each for each in wanted if each[0] in found - changing))

    @cached_property
    def denying(self) -> frozenset[str]:
        """The static predicates that decide whether a fact denies another one, such as a default."""
        bodies = [
            (*operator.body, *each.body, operator.parameters)
            for operator in self.problem.domain.deductive_operators
            for each in operator.consequences
            if operator.trigger.positive and not each.implied
        ]
        found = {name for body in bodies for name in names(body)}
        while True:
            rules = [each for each in self.problem.domain.asp if each.defines and each.defines[0] in found]
            more = found | {use.predicate[0] for each in rules for use in each.uses}
            if more == found:
                return frozenset(found)
            found = more

    @cached_property
    def dangling(self) -> tuple[str, ...]:
        """Names that facts, goals and stages mention and that no object has."""
        atoms = (*self.problem.statics, *self.problem.initial)
        terms = {
            inner
            for atom in (*atoms, *(stage for chain in self.problem.chains for stage in chain.stages))
            for argument in atom.arguments
            for inner in subterms(argument)
        }
        said = {str(each) for each in terms if isinstance(each, Function) and not each.arguments}
        said |= set(names(self.problem.goal))
        domain = self.problem.domain
        known = {*domain.objects, *self.problem.objects, *domain.predicates, *domain.functions, *domain.types}
        return tuple(sorted(said.difference(known, UNLISTED)))

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
        read = {use.predicate[0] for each in self.problem.domain.asp for use in each.uses}
        return frozenset(read | {name for part in parts for name in names(part)})

    def arguments(self, signature: Signature) -> tuple[tuple[Term, ...], ...]:
        """The values that each argument of a predicate could take."""
        predicate = self.problem.domain.predicates.get(signature[0])
        if predicate is None:
            return tuple(self._beside(signature, place) for place in range(signature[1]))
        return tuple(self._values(signature, place, type_) for place, type_ in enumerate(predicate.arguments))

    def _values(self, signature: Signature, place: int, type_: str) -> tuple[Term, ...]:
        if type_ in NUMERIC_TYPES:
            return tuple(map(Number, self._numbers(signature, place)))
        if type_ == "text":
            return tuple(sorted({each for each in self._mentioned if isinstance(each, Text)}, key=str))
        return tuple(sorted((row[0] for row in self.rows((type_, 1))), key=str))

    def _beside(self, signature: Signature, place: int) -> tuple[Term, ...]:
        """For a predicate without declaration: values like those that it has at this place."""
        values = {fact.arguments[place] for fact in self._given(signature)}
        objects = {**self.problem.domain.objects, **self.problem.objects}
        types = {objects[str(each)] for each in values if str(each) in objects}
        values |= {Function(name) for name, type_ in objects.items() if type_ in types}
        if any(isinstance(each, Number) for each in values):
            values |= set(map(Number, self._numbers(signature, place)))
        return tuple(sorted(values, key=str))

    def _given(self, signature: Signature) -> Iterator[Atom]:
        facts = (*self.problem.statics, *self.problem.initial)
        return (each for each in facts if (each.name, len(each.arguments)) == signature)

    def _numbers(self, signature: Signature, place: int) -> list[int]:
        """Small numbers, those that anything mentions, and those beside which a comparison changes."""
        own = {fact.arguments[place] for fact in self._given(signature)}
        found = {each.value for each in self._mentioned if isinstance(each, Number)}
        found |= {each.value + step for each in own if isinstance(each, Number) for step in (-1, 1)}
        wanted = (Function(signature[0]), Number(place))
        found |= {
            row[2].value
            for row in self.rows((THRESHOLD, 3))
            if row[:2] == wanted and isinstance(row[2], Number)
        }
        if signature[0] in self.problem.domain.quantities:
            found |= {number + step for number in self._compared for step in (-1, 0, 1)}
        return sorted(found | set(range(SMALL + 1)))

    @cached_property
    def _compared(self) -> frozenset[int]:
        """The numbers in goals and conditions of operators: with values beside them, a quantity may be enough."""
        conditions = (self.problem.goal, *(each.precondition for each in self.problem.domain.operators))
        found = (each for condition in conditions for each in values(condition))
        return frozenset(each.value for each in found if isinstance(each, Number))

    @cached_property
    def _mentioned(self) -> frozenset[Term]:
        """Every number and text in a fact, a reachable atom or a stage."""
        held = (
            row
            for (name, _), rows in self.atoms.items()
            if name != THRESHOLD and not name.startswith(("_o_", MISSED, "_goal", *AUXILIARY))
            for row in rows
        )
        terms = (inner for row in held for argument in row for inner in subterms(argument))
        return frozenset(each for each in terms if isinstance(each, Number | Text))

    def _bodies(self) -> Iterator[str]:
        """Every body over statics, as ASP text."""
        domain = self.problem.domain
        yield from (", ".join(each.body) for each in domain.asp if each.body)
        parts = [*(each.body for each in domain.rules), *(each.body for each in domain.defaults)]
        parts += [(*each.body, *_plain(each.precondition)) for each in domain.operators]
        for deductive in domain.deductive_operators:
            parts += [(*deductive.body, *each.body) for each in deductive.consequences]
        yield from (", ".join(map(str, body)) for body in parts if body)

    def _numeric(self) -> list[Signature]:
        declared = {
            (each.name, len(each.arguments))
            for each in self.problem.domain.predicates.values()
            if set(each.arguments) & set(NUMERIC_TYPES)
        }
        return sorted(declared | {(each.name, len(each.arguments)) for each in self.problem.statics})


def _plain(condition: Condition) -> Body:
    """The conjuncts of a condition that are literals, comparisons or aggregates."""
    return tuple(part for part in goal_parts(condition) if isinstance(part, Literal | Comparison | Aggregate))


def names(value: object) -> Iterator[str]:
    """The names of all predicates, terms and types in a value of the model, repeated as they repeat."""
    for each in values(value):
        if isinstance(each, Function):
            yield each.name
        if isinstance(each, Parameter):
            yield each.type
        if isinstance(each, Aggregate):
            yield from (name for name, _ in each.uses)


def values(value: object) -> Iterator[object]:
    """A value of the model and all values inside it. What an aggregate counts is text."""
    yield value
    if is_dataclass(value) and not isinstance(value, Aggregate):
        for each in fields(value):
            yield from values(getattr(value, each.name))
    elif isinstance(value, tuple):
        for each in value:
            yield from values(each)
