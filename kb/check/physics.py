"""Warnings about what cannot be so in a real cell: two bodies in one place, arms that nobody holds,
times below 0.
"""

import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.model.conditions import Condition, Exists, Literal, Not, goal_parts, literals_in
from cellwright.kb.model.domain_model import Domain, Kind, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Term,
    Variable,
    sort_naturally,
    stage_parts,
    term_variables,
    unify,
)

TIME = "time"


def check_physics(domain: Domain) -> list[Diagnostic]:
    """Warnings about the steps of a domain."""
    return [*_without_duration(domain), *_without_arm(domain), *_overruled_replies(domain)]


def check_facts(
    problem: Problem, state: Collection[Atom], statics: Collection[Atom]
) -> list[Diagnostic]:
    """Warnings about the facts and the goals of a problem; `state` is its whole initial state,
    `statics` are its static facts.
    """
    return [
        *_shared_places(problem, state),
        *_negative_times(problem, statics),
        *_static_goals(problem),
        *_unmade_goals(problem, state),
    ]


def _without_duration(domain: Domain) -> Iterator[Diagnostic]:
    timed = [each for each in domain.operators if each.duration is not None]
    for each in domain.operators if timed else ():
        if each.duration is None:
            said = (
                f"{each.header} has no duration, but {timed[0].header} has one: it would take "
                "no time"
            )
            yield Diagnostic(
                each.where, "K317", said, "add `duration:`; write 0 if that is meant", warning=True
            )


def _without_arm(domain: Domain) -> Iterator[Diagnostic]:
    """Steps that command a device of which they hold nothing, although all others that command
    it hold the same.
    """
    groups: dict[str, list[Operator]] = defaultdict(list)
    for each in domain.operators:
        if each.command is not None and (name := _name(each.command.stream, each)):
            groups[name].append(each)
    for name, group in groups.items():
        for each in group:
            held = [_held(one) for one in group if one is not each]
            common = frozenset.intersection(*held) if held else frozenset()
            own = _held(each)
            if (lacking := common - own) and own <= common and not _holds_device(each, name):
                what = ", ".join(sorted(lacking))
                said = (
                    f"{each.header} moves {name} and does not hold {what}; all other steps of "
                    f"{name} do"
                )
                hint = (
                    f"add {what} to its resources, or {name} may be told to do two things at "
                    "the same moment"
                )
                yield Diagnostic(each.where, "K305", said, hint, warning=True)


def _name(stream: Term, operator: Operator) -> str:
    """The device of a stream: its name, or the type of the variable that stands for it."""
    if isinstance(stream, Variable):
        return next((each.type for each in operator.parameters if each.variable == stream), "")
    return stream.name if isinstance(stream, Function) else ""


def _held(operator: Operator) -> frozenset[str]:
    """The resources of an operator: constants, and the types of variables."""
    types = {each.variable: each.type for each in operator.parameters}
    return frozenset(
        types.get(each, str(each)) if isinstance(each, Variable) else str(each)
        for each in operator.resources
    )


def _holds_device(operator: Operator, name: str) -> bool:
    """Whether a step holds the device that it commands, by name or as what its stream is of."""
    stream = operator.command.stream if operator.command is not None else None
    parts = stream.arguments if isinstance(stream, Function) else ()
    return name in _held(operator) or any(part in operator.resources for part in parts)


def _overruled_replies(domain: Domain) -> Iterator[Diagnostic]:
    """Steps whose reply has a variable that conditions bind: what is replied would not be
    compared with it.
    """
    for each in domain.operators:
        if each.command is None:
            continue
        bound = {
            variable
            for part in (*goal_parts(each.precondition), *each.body)
            if isinstance(part, Literal) and part.positive
            for variable in term_variables(part.atom)
        }
        header = set(term_variables(each.header))
        for variable in dict.fromkeys(term_variables(each.command.reply)):
            if variable in bound - header and variable != ANYTHING:
                said = (
                    f"the reply of {each.header} has {variable}, which a condition of the step "
                    "binds: a reply with another "
                    "value would not be noticed"
                )
                hint = (
                    f"add {variable} to the header, so that another reply is an exception; or "
                    "use a name of its own"
                )
                yield Diagnostic(each.where, "K318", said, hint, warning=True)


def _shared_places(problem: Problem, state: Collection[Atom]) -> Iterator[Diagnostic]:
    """Initial facts that put two things where each step that puts something needs that nothing
    is there.
    """
    for name, things in _exclusive(problem.domain):
        inside: dict[tuple[Term, ...], list[Atom]] = defaultdict(list)
        for atom in state:
            if atom.name == name:
                place = tuple(
                    each for number, each in enumerate(atom.arguments) if number not in things
                )
                inside[place].append(atom)
        for atoms in inside.values():
            if len(atoms) > 1:
                shown = sort_naturally(atoms)
                said = (
                    f"{' and '.join(map(str, shown[:3]))} hold at the start, but no step puts "
                    "one of them where "
                    "another one is"
                )
                where = place_of_fact(problem, shown[-1])
                yield Diagnostic(
                    where,
                    "K314",
                    said,
                    "give one of them another place under `initial:`",
                    warning=True,
                )


def _exclusive(domain: Domain) -> Iterator[tuple[str, frozenset[int]]]:
    """Fluents of which steps add none where there is another one, with the arguments in which
    those may differ.
    """
    for predicate in domain.predicates.values():
        if predicate.kind is Kind.FLUENT:
            ways = [
                _thing(domain, operator, effect.atom)
                for operator in domain.operators
                for effect in operator.effects
                if effect.adds and effect.atom.name == predicate.name
            ]
            if ways and ways[0] and all(each == ways[0] for each in ways):
                yield predicate.name, ways[0]


def _thing(domain: Domain, operator: Operator, added: Atom) -> frozenset[int]:
    """The arguments in which an added atom differs from those that its operator excludes; none
    if it excludes none.
    """
    for excluded, free in _excluded(domain, operator.precondition):
        if excluded.name == added.name and len(excluded.arguments) == len(added.arguments):
            pairs = enumerate(zip(excluded.arguments, added.arguments, strict=True))
            apart = frozenset(number for number, (one, other) in pairs if one != other)
            if apart and all(excluded.arguments[number] in free for number in apart):
                return apart
    return frozenset()


def _excluded(domain: Domain, condition: Condition) -> Iterator[tuple[Atom, Collection[Term]]]:
    """The atoms that a condition excludes for any value of some variables, also by a derived
    predicate.
    """
    for part in goal_parts(condition):
        match part:
            case Not(Exists(parameters, Literal(atom, True))):
                yield atom, {each.variable for each in parameters}
            case Literal(atom, False):
                yield atom, {ANYTHING}
            case Literal(atom, True) if domain.predicates[atom.name].kind is Kind.DERIVED:
                rules = [each for each in domain.rules if each.head.name == atom.name]
                if len(rules) == 1 and (bound := unify(rules[0].head, atom, {})) is not None:
                    for inner in rules[0].body:
                        if isinstance(inner, Literal) and not inner.positive:
                            yield (
                                _bound(inner.atom, bound),
                                {ANYTHING, *_own(rules[0].head, inner.atom)},
                            )


def _bound(atom: Atom, bindings: dict[Variable, Term]) -> Atom:
    arguments = tuple(
        bindings.get(each, each) if isinstance(each, Variable) else each for each in atom.arguments
    )
    return Function(atom.name, arguments)


def _own(head: Atom, atom: Atom) -> set[Variable]:
    return set(term_variables(atom)) - set(term_variables(head))


def _negative_times(problem: Problem, statics: Collection[Atom]) -> Iterator[Diagnostic]:
    """Facts that give a time, a tolerance or a capacity below 0."""
    predicates, words = problem.domain.predicates, problem.domain.conventions
    sizes = {
        words.tolerance,
        words.bore,
        words.priority,
        words.aligned_within,
        words.change,
        words.shift,
    }
    for fact in sort_naturally(statics):
        declared = predicates.get(fact.name)
        types = declared.arguments if declared else ()
        for number, each in enumerate(fact.arguments):
            timed = number < len(types) and types[number] == TIME
            if isinstance(each, Number) and each.value < 0 and (timed or fact.name in sizes):
                said = f"{fact} has {each} as argument {number + 1}, which cannot be less than 0"
                yield Diagnostic(
                    place_of_fact(problem, fact), "K113", said, "write 0 or more", warning=True
                )


def _static_goals(problem: Problem) -> Iterator[Diagnostic]:
    """Goals that ask for static facts alone, which no step changes."""
    predicates = problem.domain.predicates
    for part in goal_parts(problem.goal):
        asked = list(literals_in(part))
        kinds = {predicates[each.atom.name].kind for each in asked if each.atom.name in predicates}
        if asked and kinds == {Kind.STATIC}:
            said = f"the goal {part} is a static fact: no step makes it true or false"
            hint = "take it out of the goals; name what a step makes true"
            yield Diagnostic(
                place_of_fact(problem, asked[0].atom, "goals"), "K108", said, hint, warning=True
            )


def _unmade_goals(problem: Problem, state: Collection[Atom]) -> Iterator[Diagnostic]:
    """Goals and stages that no step, rule or default makes true and that do not hold at the
    start.
    """
    makers = list(_made(problem.domain))
    asked = [
        (each.atom, "goals")
        for part in goal_parts(problem.goal)
        for each in (
            [part] if isinstance(part, Literal) else [part.part] if isinstance(part, Exists) else []
        )
        if isinstance(each, Literal) and each.positive
    ]
    asked += [
        (part, "workflow")
        for chain in problem.chains
        if chain.wanted
        for stage in chain.stages
        for part in stage_parts(stage)
    ]
    for atom, key in dict.fromkeys(asked):
        declared = problem.domain.predicates.get(atom.name)
        if (
            declared is None
            or declared.kind is Kind.STATIC
            or atom.name in problem.domain.quantities
        ):
            continue
        wanted = _apart(atom)
        if not any(
            unify(_apart(each, "_made"), wanted, {}) is not None for each in (*makers, *state)
        ):
            what = "goal" if key == "goals" else "stage"
            said = (
                f"the {what} {atom} can never be reached: no step, no rule and no default makes "
                "it true"
            )
            hint = "look at what steps add, and at the names in it"
            yield Diagnostic(place_of_fact(problem, atom, key), "K310", said, hint, warning=True)


def _made(domain: Domain) -> Iterator[Atom]:
    """The atoms that anything in a domain makes true."""
    yield from (each.atom for o in domain.operators for each in o.effects if each.adds)
    yield from (
        each.atom for d in domain.deductive_operators for each in d.consequences if each.implied
    )
    yield from (each.atom for each in domain.defaults)
    yield from (each.head for each in domain.rules)


def _apart(atom: Atom, mark: str = "_wanted") -> Atom:
    """An atom with variables of its own, a new one for each `_`, and one for whatever is
    calculated.
    """
    count = iter(range(1 << 20))

    def renamed(term: Term) -> Term:
        match term:
            case Variable() if term == ANYTHING:
                return Variable(f"_{mark}{next(count)}")
            case Variable(name):
                return Variable(f"{name}{mark}")
            case Function(name, arguments):
                return Function(name, tuple(map(renamed, arguments)))
            case Number():
                return term
            case _:
                return term if not list(term_variables(term)) else Variable(f"_{mark}{next(count)}")

    return Function(atom.name, tuple(map(renamed, atom.arguments)))


def place_of_fact(problem: Problem, atom: Atom, key: str = "") -> Source:
    """Where a file of a problem says an atom, as far as its text shows; else the problem."""
    if not problem.path:
        return problem.where
    try:
        file = read_file(Path(problem.path), problem.where.path)
    except (InvalidInput, OSError):
        return problem.where
    begin = re.search(rf"^{key}:", file.text, re.MULTILINE) if key else None
    start = begin.end() if begin else 0
    spaced = re.escape(str(atom)).replace(r",\ ", r",\s*").replace(",", r",")
    for pattern in (spaced, rf"\b{re.escape(atom.name)}\s*\(", rf"\b{re.escape(atom.name)}\b"):
        if found := re.compile(pattern).search(file.text, start):
            return file.at(found.start())
    return problem.where
