"""Excerpts of large problems: most objects of which many are alike are left out.

Facts are evaluated by clingo over all objects of a problem, although a plan for one measurement
asks for few of them. So objects are left out before. Two objects are alike if exchanging them
changes no fact that operators can read, no rule, no goal, and no fact of the state. Of a class of
alike objects as many stay as a rule has variables, and some more. A rule cannot tell more objects
than it has variables, so nothing changes for those that stay (Immerman 1982: formulas with v
variables do not tell sets of v and of more elements apart). Rules that count, or that order
objects, can tell; a problem with such rules stays whole.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

from cellwright.kb.asp.static_program import VIOLATED, dependency_closure
from cellwright.kb.model.conditions import Comparison, Condition, Literal
from cellwright.kb.model.conditions import all_conditions as parts_of
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Domain
from cellwright.kb.model.object_likeness import (
    alike_objects,
    constant_names,
    domain_bodies,
    free_objects,
    most_at_once,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.statement import Sign, Statement
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import Atom, Function, Operation, Term, Variable, term_variables

ORDER_SIGN = re.compile(r"[<>]")
ASP_VARIABLE = re.compile(r"\b_*[A-Z]\w*|\b_\b")
ASP_NAME = re.compile(r"\b[a-z]\w*")
QUOTED_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"')
ORDER_RELATIONS = ("<", "<=", ">", ">=")


def excerpt_problem(problem: Problem, named: Collection[str] = ()) -> Problem:
    """The problem without most objects of which many are alike; those that are `named` stay.

    It is the same problem if there are not that many, or if a rule could tell.
    """
    domain = problem.domain
    counts = Counter(problem.objects.values())
    if max(counts.values(), default=0) <= (widest := _max_variables(domain)) or _tells_apart(
        domain
    ):
        return problem
    most = {type_: widest + 1 + most_at_once(domain, type_) for type_ in counts}
    many = {type_ for type_, count in counts.items() if count > most[type_]} - _ranged_types(
        domain, counts
    )
    fixed = {*named, *_named_objects(problem)}
    free = {
        name: type_
        for name, type_ in free_objects(problem).items()
        if type_ in many and name not in fixed
    }
    free = {name: type_ for name, type_ in free.items() if name in problem.objects}
    if not free:
        return problem
    read = dependency_closure(domain, _readable_predicates(domain))
    facts = (fact for fact in problem.statics if fact.name in read)
    classes = alike_objects(free, (*facts, *problem.initial))
    gone = {name for group in classes for name in group[most[free[group[0]]] :]}
    return _drop_objects(problem, gone) if gone else problem


def _drop_objects(problem: Problem, gone: set[str]) -> Problem:
    """The problem without some objects and without the facts that name them."""
    return replace(
        problem,
        objects={name: type_ for name, type_ in problem.objects.items() if name not in gone},
        statics=_facts_without(problem.statics, _names_of(problem.statics), gone),
        initial=_facts_without(problem.initial, map(constant_names, problem.initial), gone),
    )


def _facts_without(
    facts: Iterable[Atom], named: Iterable[Iterable[str]], gone: set[str]
) -> tuple[Atom, ...]:
    return tuple(fact for fact, about in zip(facts, named, strict=True) if gone.isdisjoint(about))


@lru_cache(maxsize=2)
def _names_of(facts: tuple[Atom, ...]) -> tuple[tuple[str, ...], ...]:
    """The objects that each fact names.

    A problem's facts are asked for again when its plan is checked.
    """
    return tuple(tuple(constant_names(fact)) for fact in facts)


def _named_objects(problem: Problem) -> Iterator[str]:
    """The objects that rules, defaults and given durations name."""
    for statement in problem.domain.asp:
        yield from statement.names or ASP_NAME.findall(statement.text)
    for default in problem.domain.defaults:
        for term in _condition_terms([Literal(default.atom), *default.body]):
            yield from constant_names(Function("", (term,)))
    for step in problem.durations:
        yield from constant_names(step)


def _ranged_types(domain: Domain, types: Iterable[str]) -> set[str]:
    """Those of some types over whose objects defaults range: which of several defaults holds is
    a matter of names.
    """
    ranged = {parameter.type for default in domain.defaults for parameter in default.parameters}
    return {
        type_
        for type_ in types
        if any(_may_name(domain, default_type, type_) for default_type in ranged)
    }


def _may_name(domain: Domain, wanted: str, type_: str) -> bool:
    """Whether a value of a type can be, or hold, an object of another type."""
    if domain.is_subtype(type_, wanted):
        return True
    functions = (
        function
        for function in domain.functions.values()
        if domain.is_subtype(function.result, wanted)
    )
    return any(
        _may_name(domain, argument, type_)
        for function in functions
        for argument in function.arguments
    )


def _readable_predicates(domain: Domain) -> set[str]:
    """The predicates and types that anything but the rules of the domain can read.

    Travel times tie all places to one another; they change how long a plan lasts, and not what is
    possible.
    """
    spoken = {
        name for terms in _statement_terms(domain) for term in terms for name in _names_inside(term)
    }
    return {VIOLATED, *domain.types, *(spoken - {domain.conventions.travel})}


def _names_inside(term: Term | None) -> Iterator[str]:
    match term:
        case Function(name, arguments):
            yield name
            for argument in arguments:
                yield from _names_inside(argument)
        case Operation(_, left, right):
            yield from _names_inside(left)
            yield from _names_inside(right)
        case _:
            return


def _statement_terms(domain: Domain) -> Iterator[list[Term]]:
    """Operators, deductive operators, defaults and rules over fluents, each as all its terms."""
    for operator in domain.operators:
        parts = [*parts_of(operator.precondition), *operator.body]
        parts += [part for effect in operator.effects for part in parts_of(effect.condition)]
        yield [
            *operator.variables,
            *_condition_terms(parts),
            *(effect.atom for effect in operator.effects),
            *operator.amounts,
        ]
    for deductive in domain.deductive_operators:
        follows = [
            part
            for consequence in deductive.consequences
            for part in (Literal(consequence.atom), *consequence.body)
        ]
        yield [*_condition_terms([deductive.trigger, *deductive.body, *follows])]
    for default in domain.defaults:
        yield [*_condition_terms([Literal(default.atom), *default.body])]
    for rule in domain.rules:
        yield [*_condition_terms([Literal(rule.head), *rule.body])]


def _condition_terms(parts: Iterable[Condition]) -> Iterator[Term]:
    for part in parts:
        match part:
            case Literal(atom):
                yield atom
            case Comparison(left, _, right):
                yield from (left, right)


def _max_variables(domain: Domain) -> int:
    """The most variables of a rule or of anything like it; each `_` counts as one."""
    occurrences = [
        (statement.variables, ASP_VARIABLE.findall(statement.text).count("_"))
        for statement in domain.asp
    ]
    for terms in _statement_terms(domain):
        own = [v.name for statement_term in terms for v in term_variables(statement_term)]
        occurrences.append((tuple(own), own.count("_")))
    return max((len(set(own)) + blank for own, blank in occurrences), default=0)


def _tells_apart(domain: Domain) -> bool:
    """Whether something in the domain may count objects, or order them."""
    if any(
        not isinstance(part, Literal | Comparison)
        for default in domain.defaults
        for part in default.body
    ):
        return True
    return any(map(_counts_objects, domain.asp)) or any(
        _orders_objects(domain, body) for body in _ordered_variables(domain)
    )


def _counts_objects(statement: Statement) -> bool:
    return bool(statement.constant) or any(use.sign is Sign.COUNTED for use in statement.uses)


def _ordered_variables(domain: Domain) -> Iterator[tuple[list[Atom], set[str]]]:
    """For each rule the atoms that bind its variables, and the variables that it puts in order."""
    for statement in domain.asp:
        parts = [QUOTED_TEXT.sub("_", part) for part in statement.body]
        ordered = {
            name for part in parts if ORDER_SIGN.search(part) for name in ASP_VARIABLE.findall(part)
        }
        yield (
            [
                atom
                for part in parts
                for atom in plain_terms(part) or ()
                if isinstance(atom, Function)
            ],
            ordered,
        )
    for body in domain_bodies(domain):
        atoms = [part.atom for part in body if isinstance(part, Literal)]
        orders = [
            part
            for part in body
            if isinstance(part, Comparison) and part.relation in ORDER_RELATIONS
        ]
        yield (
            atoms,
            {
                v.name
                for part in orders
                for side in (part.left, part.right)
                for v in term_variables(side)
            },
        )


def _orders_objects(domain: Domain, rule: tuple[list[Atom], set[str]]) -> bool:
    """Whether a rule puts anything in order that need not be a number."""
    atoms, ordered = rule
    return not ordered <= {name for atom in atoms for name in _number_variables(domain, atom)}


def _number_variables(domain: Domain, atom: Atom) -> Iterator[str]:
    """The variables in an atom that can only be numbers."""
    declared = domain.predicates.get(atom.name)
    for argument, type_ in zip(
        atom.arguments, declared.arguments if declared else (), strict=False
    ):
        if isinstance(argument, Variable) and type_ in NUMERIC_TYPES:
            yield argument.name
