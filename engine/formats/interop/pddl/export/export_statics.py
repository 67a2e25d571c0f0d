"""What never changes in an exported problem: static facts, objects and their types, computed once
by clingo.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property

from cellwright.engine.model.ground_task import GroundTask
from cellwright.kb.asp import AspError, Grounder
from cellwright.kb.asp.static_facts import ground_statics
from cellwright.kb.asp.static_program import type_guard
from cellwright.kb.model.conditions import Body, Parameter
from cellwright.kb.model.domain_model import NUMERIC_TYPES, OBJECT_TYPE, Kind
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term, Text, Variable, natural_key

# in PDDL, numbers, texts and chains are objects
NUMERAL, WORDS, CHAIN = "_numeral", "_text", "_chain"


class NotLiftable(Exception):
    """A construct that lifted PDDL cannot express. The ground task can."""


class Background:
    """The statics of a problem: facts by predicate, the objects of each type, and one declared
    type per object.
    """

    def __init__(self, problem: Problem, task: GroundTask) -> None:
        self.problem, self.domain, self.task = problem, problem.domain, task
        self.kinds = {name: predicate.kind for name, predicate in self.domain.predicates.items()}
        self._grounder = Grounder()
        ground_statics(self._grounder, problem)
        self.facts: dict[str, list[Atom]] = defaultdict(list)
        for fact in self._grounder.everything():
            self.facts[fact.name].append(fact)
        self.known = {fact for facts in self.facts.values() for fact in facts}
        self._tables = 0

    @cached_property
    def _minimal(self) -> dict[Term, list[str]]:
        """The most specific types of each object, in order of declaration."""
        types: dict[Term, list[str]] = defaultdict(list)
        for name in self.domain.types:
            for fact in self.facts[name]:
                types[fact.arguments[0]].append(name)
        return {
            term: [
                narrow for narrow in names if not any(self._below(wider, narrow) for wider in names)
            ]
            for term, names in types.items()
        }

    def _below(self, name: str, ancestor: str) -> bool:
        return name != ancestor and self.domain.is_subtype(name, ancestor)

    @cached_property
    def shared(self) -> frozenset[str]:
        """Types whose objects PDDL would have to declare under two parents: they become static
        predicates.
        """
        shared_types = set()
        for names in self._minimal.values():
            above = {
                each
                for each in self.domain.types
                for name in names
                if self.domain.is_subtype(name, each)
            }
            shared_types.update(above - set(self.ancestors(names[0])))
        return frozenset(shared_types)

    def ancestors(self, name: str) -> tuple[str, ...]:
        """A type and the declared ones above it."""
        lineage: list[str] = []
        while name in self.domain.types and name not in lineage:
            lineage.append(name)
            name = self.domain.types[name].parent
        return tuple(lineage)

    def type_of(self, term: Term) -> str:
        """The type under which an object is declared."""
        if isinstance(term, Number):
            return NUMERAL
        if isinstance(term, Text):
            return WORDS
        if isinstance(term, Function) and term.name == CHAIN:
            return CHAIN
        return self.plain(self._minimal.get(term, [OBJECT_TYPE])[0])

    def plain(self, name: str) -> str:
        """The nearest type that PDDL can declare."""
        if name in NUMERIC_TYPES:
            return NUMERAL
        if name == "text":
            return WORDS
        return next(
            (
                ancestor_type
                for ancestor_type in self.ancestors(name)
                if ancestor_type not in self.shared
            ),
            self._built_in(name),
        )

    def _built_in(self, name: str) -> str:
        return name if name in (NUMERAL, WORDS, CHAIN) else OBJECT_TYPE

    def is_subtype(self, name: str, ancestor: str) -> bool:
        """Whether every object of one type is of another."""
        return ancestor == OBJECT_TYPE or name == ancestor or ancestor in self.ancestors(name)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Every object and all its parts, in natural order."""
        used_terms: dict[Term, None] = {}
        for name in self.domain.types:
            for fact in self.facts[name]:
                used_terms.update(dict.fromkeys(_subterms_of(fact.arguments[0])))
        for atom in self.task.atoms:
            if self.kinds.get(atom.name) is Kind.FLUENT:
                used_terms.update(
                    dict.fromkeys(sub for term in atom.arguments for sub in _subterms_of(term))
                )
        return tuple(sorted(used_terms, key=natural_key))

    @cached_property
    def initial(self) -> tuple[Atom, ...]:
        """The fluents that are true at the start, with all consequences of the given ones."""
        start = self.task.names(self.task.initial)
        return tuple(atom for atom in start if self.kinds.get(atom.name) is Kind.FLUENT)

    def is_static(self, name: str) -> bool:
        """Whether no operator can change the predicate."""
        return self.kinds.get(name, Kind.STATIC) is Kind.STATIC

    def table(self, body: Body, parameters: Iterable[Parameter]) -> list[tuple[Term, ...]]:
        """Every binding of the parameters that satisfies a static body.

        Raises `NotLiftable` if they are unbound.
        """
        parameters = tuple(parameters)
        self._tables += 1
        name = f"_export_{self._tables}"
        head = Function(name, tuple(parameter.variable for parameter in parameters))
        text = ", ".join([*type_guard(parameters), *map(str, body)])
        try:
            self._grounder.ground(f"{head} :- {text}." if text else f"{head}.")
        except AspError as error:
            raise NotLiftable(str(error)) from None
        return sorted(
            self._grounder.atoms(name, len(parameters)),
            key=lambda row: [natural_key(t) for t in row],
        )

    def signature(self, name: str) -> tuple[str, ...]:
        """The argument types of a predicate or type; empty for predicates that only rules use."""
        if name in self.domain.types:
            return (name,)
        predicate = self.domain.predicates.get(name)
        return predicate.arguments if predicate else ()


def _subterms_of(term: Term) -> Iterator[Term]:
    yield term
    if isinstance(term, Function):
        for argument in term.arguments:
            yield from _subterms_of(argument)


class FreshVariables:
    """Variables that are used nowhere else."""

    def __init__(self) -> None:
        self._count = 0

    def variable(self, like: str) -> Variable:
        """A new variable with a readable name; a number makes it unique."""
        self._count += 1
        return Variable(f"{like[:1].upper()}{like[1:]}__{self._count}")
