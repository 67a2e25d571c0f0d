"""The measurements of a problem: which there are, and which its goals ask for."""

from collections.abc import Collection

from cellwright.kb.model.conditions import Condition, Literal, goal_parts
from cellwright.kb.model.conditions import literals as literals_of
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Term


def chooses_tools(domain: Domain) -> bool:
    """Whether the rules of a domain say which tool takes which measurement."""
    return domain.conventions.chosen in domain.predicates


def arms_of(problem: Problem) -> tuple[str, ...]:
    """The arms that can be the second argument of `measured`; none if it has no such argument."""
    domain = problem.domain
    declared = domain.predicates.get(domain.conventions.measured)
    if declared is None or len(declared.arguments) < 3:
        return ()
    objects = {**domain.objects, **problem.objects}
    return tuple(name for name, own in objects.items() if domain.is_subtype(own, declared.arguments[1]))


def is_shared(problem: Problem) -> bool:
    """Whether several arms can make the measurements of a problem, whose rules choose the tools."""
    return chooses_tools(problem.domain) and len(arms_of(problem)) > 1


def measurements_of(problem: Problem) -> list[str]:
    """The objects of a problem that are measurements, in the order in which they are listed."""
    objects, type_ = {**problem.domain.objects, **problem.objects}, problem.domain.conventions.measurement
    return [name for name, own in objects.items() if own == type_]


def wanted(problem: Problem) -> set[str]:
    """The measurements that the goals name."""
    known = set(measurements_of(problem))
    return {name for goal in goal_parts(problem.goal) for name in named(goal, known)}


def is_put_in_order(problem: Problem) -> bool:
    """Whether the goals name measurements that the sequencer puts in order, or shares among arms."""
    least = 1 if is_shared(problem) else 2
    return chooses_tools(problem.domain) and len(wanted(problem)) >= least


def asked_for(problem: Problem) -> set[str] | None:
    """The measurements that goals and workflows name; None if that is all of them, or if some goal names none: it may take any."""
    known = set(measurements_of(problem))
    stages = (Literal(stage) for chain in problem.chains for stage in chain.stages)
    names = [named(each, known) for each in (*goal_parts(problem.goal), *stages)]
    found = set[str]().union(*names)
    return found if all(names) and found < known else None


def named(goal: Condition, known: Collection[str]) -> set[str]:
    """Those of some names that a goal names."""
    return {name for literal in literals_of(goal) for name in _constants(literal.atom) if name in known}


def _constants(term: Term) -> set[str]:
    if not isinstance(term, Function):
        return set()
    own = set() if term.arguments else {term.name}
    return own.union(*map(_constants, term.arguments))
