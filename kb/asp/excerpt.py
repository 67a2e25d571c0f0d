"""Excerpts of large problems: what is true of the objects that stay is what was true of them in the whole problem.

Facts are evaluated by clingo over all objects of a problem, although a plan for one measurement asks for few of them. So
objects are left out before. Two objects are alike if exchanging them changes no fact that operators can read, no rule, no
goal, and no fact of the state. Of a class of alike objects as many stay as a rule has variables, and some more. A rule
cannot tell more objects than it has variables, so nothing changes for those that stay (Immerman 1982: formulas with v
variables do not tell sets of v and of more elements apart). Rules that count, or that order objects, can tell; a
problem with such rules stays whole.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache

from cellwright.kb.asp.vocabulary import VIOLATED, resting
from cellwright.kb.model.conditions import Comparison, Condition, Literal
from cellwright.kb.model.conditions import conditions as parts_of
from cellwright.kb.model.domain import NUMERIC_TYPES, Domain
from cellwright.kb.model.likeness import alike, bodies, free_objects, most_at_once, names
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.statement import Sign, Statement
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import Atom, Function, Operation, Term, Variable, variables

ORDERED = re.compile(r"[<>]")
VARIABLE = re.compile(r"\b_*[A-Z]\w*|\b_\b")
WORD = re.compile(r"\b[a-z]\w*")
QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"')
ORDERS = ("<", "<=", ">", ">=")


def excerpt(problem: Problem, named: Collection[str] = ()) -> Problem:
    """The problem without most objects of which many are alike; those that are `named` stay.

    It is the same problem if there are not that many, or if a rule could tell.
    """
    domain = problem.domain
    counts = Counter(problem.objects.values())
    if max(counts.values(), default=0) <= (widest := _widest(domain)) or _tells_apart(domain):
        return problem
    most = {type_: widest + 1 + most_at_once(domain, type_) for type_ in counts}
    many = {type_ for type_, count in counts.items() if count > most[type_]} - _ranged(domain, counts)
    fixed = {*named, *_named(problem)}
    free = {
        name: type_ for name, type_ in free_objects(problem).items() if type_ in many and name not in fixed
    }
    free = {name: type_ for name, type_ in free.items() if name in problem.objects}
    if not free:
        return problem
    read = resting(domain, _read(domain))
    facts = (fact for fact in problem.statics if fact.name in read)
    classes = alike(free, (*facts, *problem.initial))
    gone = {name for each in classes for name in each[most[free[each[0]]] :]}
    return _without(problem, gone) if gone else problem


def _without(problem: Problem, gone: set[str]) -> Problem:
    """The problem without some objects and without the facts that name them."""
    return replace(
        problem,
        objects={name: type_ for name, type_ in problem.objects.items() if name not in gone},
        statics=_kept(problem.statics, _names_of(problem.statics), gone),
        initial=_kept(problem.initial, map(names, problem.initial), gone),
    )


def _kept(facts: Iterable[Atom], named: Iterable[Iterable[str]], gone: set[str]) -> tuple[Atom, ...]:
    return tuple(fact for fact, about in zip(facts, named, strict=True) if gone.isdisjoint(about))


@lru_cache(maxsize=2)
def _names_of(facts: tuple[Atom, ...]) -> tuple[tuple[str, ...], ...]:
    """The objects that each fact names. A problem's facts are asked for again when its plan is checked."""
    return tuple(tuple(names(fact)) for fact in facts)


def _named(problem: Problem) -> Iterator[str]:
    """The objects that rules, defaults and given durations name."""
    for each in problem.domain.asp:
        yield from each.names or WORD.findall(each.text)
    for default in problem.domain.defaults:
        for term in _terms([Literal(default.atom), *default.body]):
            yield from names(Function("", (term,)))
    for step in problem.durations:
        yield from names(step)


def _ranged(domain: Domain, types: Iterable[str]) -> set[str]:
    """Those of some types over whose objects defaults range: which of several defaults holds is a matter of names."""
    ranged = {each.type for default in domain.defaults for each in default.parameters}
    return {type_ for type_ in types if any(_may_name(domain, each, type_) for each in ranged)}


def _may_name(domain: Domain, wanted: str, type_: str) -> bool:
    """Whether a value of a type can be, or hold, an object of another type."""
    if domain.is_subtype(type_, wanted):
        return True
    made = (each for each in domain.functions.values() if domain.is_subtype(each.result, wanted))
    return any(_may_name(domain, argument, type_) for each in made for argument in each.arguments)


def _read(domain: Domain) -> set[str]:
    """The predicates and types that anything but the rules of the domain can read.

    Travel times tie all places to one another; they change how long a plan lasts, and not what is possible.
    """
    spoken = {name for terms in _statements(domain) for each in terms for name in _inside(each)}
    return {VIOLATED, *domain.types, *(spoken - {domain.conventions.travel})}


def _inside(term: Term | None) -> Iterator[str]:
    match term:
        case Function(name, arguments):
            yield name
            for each in arguments:
                yield from _inside(each)
        case Operation(_, left, right):
            yield from _inside(left)
            yield from _inside(right)
        case _:
            return


def _statements(domain: Domain) -> Iterator[list[Term]]:
    """Operators, deductive operators, defaults and rules over fluents, each as all its terms."""
    for operator in domain.operators:
        parts = [*parts_of(operator.precondition), *operator.body]
        parts += [part for effect in operator.effects for part in parts_of(effect.condition)]
        amounts = [each for each in (operator.duration, operator.cost) if each is not None]
        yield [*operator.variables, *_terms(parts), *(each.atom for each in operator.effects), *amounts]
    for deductive in domain.deductive_operators:
        follows = [part for each in deductive.consequences for part in (Literal(each.atom), *each.body)]
        yield [*_terms([deductive.trigger, *deductive.body, *follows])]
    for default in domain.defaults:
        yield [*_terms([Literal(default.atom), *default.body])]
    for rule in domain.rules:
        yield [*_terms([Literal(rule.head), *rule.body])]


def _terms(parts: Iterable[Condition]) -> Iterator[Term]:
    for part in parts:
        match part:
            case Literal(atom):
                yield atom
            case Comparison(left, _, right):
                yield from (left, right)


def _widest(domain: Domain) -> int:
    """The most variables of a rule or of anything like it; each `_` counts as one."""
    found = [(each.variables, VARIABLE.findall(each.text).count("_")) for each in domain.asp]
    for terms in _statements(domain):
        own = [v.name for each in terms for v in variables(each)]
        found.append((tuple(own), own.count("_")))
    return max((len(set(own)) + blank for own, blank in found), default=0)


def _tells_apart(domain: Domain) -> bool:
    """Whether something in the domain may count objects, or order them."""
    if any(not isinstance(part, Literal | Comparison) for each in domain.defaults for part in each.body):
        return True
    return any(map(_counts, domain.asp)) or any(_orders(domain, body) for body in _compared(domain))


def _counts(statement: Statement) -> bool:
    return bool(statement.constant) or any(use.sign is Sign.COUNTED for use in statement.uses)


def _compared(domain: Domain) -> Iterator[tuple[list[Atom], set[str]]]:
    """For each rule the atoms that bind its variables, and the variables that it puts in order."""
    for each in domain.asp:
        parts = [QUOTED.sub("_", part) for part in each.body]
        ordered = {name for part in parts if ORDERED.search(part) for name in VARIABLE.findall(part)}
        yield (
            [atom for part in parts for atom in plain_terms(part) or () if isinstance(atom, Function)],
            ordered,
        )
    for body in bodies(domain):
        atoms = [part.atom for part in body if isinstance(part, Literal)]
        orders = [part for part in body if isinstance(part, Comparison) and part.relation in ORDERS]
        yield atoms, {v.name for part in orders for side in (part.left, part.right) for v in variables(side)}


def _orders(domain: Domain, rule: tuple[list[Atom], set[str]]) -> bool:
    """Whether a rule puts anything in order that need not be a number."""
    atoms, ordered = rule
    return not ordered <= {name for atom in atoms for name in _numbers(domain, atom)}


def _numbers(domain: Domain, atom: Atom) -> Iterator[str]:
    """The variables in an atom that can only be numbers."""
    declared = domain.predicates.get(atom.name)
    for argument, type_ in zip(atom.arguments, declared.arguments if declared else (), strict=False):
        if isinstance(argument, Variable) and type_ in NUMERIC_TYPES:
            yield argument.name
