"""Finds faults of initial states: two things where only one fits, and states from which no goal can be reached."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import Exists, Literal, goal_parts, literals
from cellwright.kb.model.domain import DeductiveOperator, Domain, Kind, Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.workflow import reaches
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Substitution,
    match,
    ordered,
    parts_of,
    substitute,
    substitute_atom,
    unify,
    variables,
)


def crowded(problem: Problem, state: Collection[Atom], homes: Collection[Atom]) -> Iterator[Diagnostic]:
    """Warnings about initial facts, and about defaults, that put two things where only one fits.

    `homes` are the instances of the defaults; those of a thing that has several are only possibilities.
    """
    told: set[frozenset[Atom]] = set()
    for rule, room in _rooms(problem.domain):
        for atoms in (state, _sole(rule, room, homes)):
            for place, inside in _by_room(rule, room, atoms).items():
                if len(inside) < 2 or inside in told:
                    continue
                told.add(inside)
                shown = ordered(inside)
                what = "at the start" if atoms is state else "by default"
                message = (
                    f"{' and '.join(map(str, shown[:3]))} hold {what}, but {place} allows only one of them"
                )
                hint = "give one of them another place under `initial:`, or change what the default reads"
                yield Diagnostic(problem.where, "K314", message, hint, warning=True)


def _rooms(domain: Domain) -> Iterator[tuple[DeductiveOperator, Atom]]:
    """Deductive operators whose trigger takes up room: it denies an atom that each operator needs that adds the trigger."""
    for rule in domain.deductive_operators:
        if rule.trigger.positive and not rule.body:
            denied = (each.atom for each in rule.consequences if not each.implied and not each.body)
            yield from ((rule, room) for room in denied if _is_room(domain, rule.trigger.atom, room))


def _is_room(domain: Domain, made: Atom, room: Atom) -> bool:
    """Whether an atom is room that several things could take up, of which each needs it."""
    fewer = set(variables(room)) < set(variables(made))
    return fewer and room.name != made.name and _always_needed(domain, made, room)


def _always_needed(domain: Domain, made: Atom, room: Atom) -> bool:
    makers = [found for operator in domain.operators for found in _needs(operator, made, room)]
    return bool(makers) and all(makers)


def _needs(operator: Operator, made: Atom, room: Atom) -> Iterator[bool]:
    """For each effect that adds `made`: whether the operator needs the room that it takes up."""
    rename = {each: type(each)(f"{each.name}_own") for each in operator.variables}
    conditions = [
        each for each in goal_parts(operator.precondition) if isinstance(each, Literal) and each.positive
    ]
    needed = {substitute_atom(each.atom, rename) for each in conditions}
    for effect in operator.effects:
        bindings = unify(made, substitute_atom(effect.atom, rename), {}) if effect.adds else None
        if bindings is not None:
            yield _followed(room, bindings) in {_followed(each, bindings) for each in needed}


def _followed(atom: Atom, bindings: Substitution) -> Atom:
    while (after := substitute_atom(atom, bindings)) != atom:
        atom = after
    return atom


def _by_room(rule: DeductiveOperator, room: Atom, atoms: Collection[Atom]) -> Mapping[Atom, frozenset[Atom]]:
    found: dict[Atom, frozenset[Atom]] = {}
    for atom in atoms:
        bindings = match(rule.trigger.atom, atom, {})
        if bindings is not None:
            place = substitute_atom(room, bindings)
            found[place] = found.get(place, frozenset()) | {atom}
    return found


def _sole(rule: DeductiveOperator, room: Atom, atoms: Collection[Atom]) -> list[Atom]:
    """The atoms of things that have only one of them."""
    thing = [each for each in rule.trigger.atom.arguments if not set(variables(each)) <= set(variables(room))]
    owners: dict[tuple[object, ...], list[Atom]] = {}
    for atom in atoms:
        bindings = match(rule.trigger.atom, atom, {})
        if bindings is not None:
            owners.setdefault(tuple(substitute(each, bindings) for each in thing), []).append(atom)
    return [own[0] for own in owners.values() if len(own) == 1]


def hopeless(
    problem: Problem, reached: Collection[Atom], begun: bool, problems: Sequence[Problem]
) -> Iterator[Diagnostic]:
    """A warning about an initial state from which no goal of any problem can be reached, even if nothing were ever undone.

    `reached` are the atoms that can become true; `begun` says whether a chain of the problem can reach its first stage.
    Goals of derived predicates that grounding has replaced by what they stand for are not among `reached`: of them nothing is said.
    """
    wanted = {atom for each in problems for atom in _wanted(each)}
    derived = {name for name, each in problem.domain.predicates.items() if each.kind is Kind.DERIVED}
    if {atom.name for atom in wanted} & derived - {atom.name for atom in reached}:
        return
    own = set(_wanted(problem)) or {
        part for c in problem.chains for each in c.stages for part in parts_of(each)
    }
    names = {atom.name for atom in wanted}
    possible = [atom for atom in reached if atom.name in names]
    if begun or not own or any(reaches(atom, each) for each in wanted for atom in possible):
        return
    missing = _missing(problem.domain, {atom.name for atom in reached})
    shown = ", ".join(
        f"{name}({', '.join(problem.domain.predicates[name].arguments)})" for name in missing[:3]
    )
    hint = (
        f"nothing is true of {shown}: add such facts under `initial:`"
        if missing
        else "`cellwright explain` tells what is missing"
    )
    others = " or of any other problem" if len(problems) > 1 else ""
    message = f"no goal of {problem.name}{others} can be reached from this initial state"
    yield Diagnostic(problem.where, "K313", message, hint, warning=True)


def _wanted(problem: Problem) -> Iterator[Atom]:
    """The fluents that a problem asks for, as goals or stages; `_` stands for any value."""
    fluent = {name for name, each in problem.domain.predicates.items() if each.kind is not Kind.EVENT}
    for part in goal_parts(problem.goal):
        open_ = {p.variable: ANYTHING for p in part.parameters} if isinstance(part, Exists) else {}
        yield from (substitute_atom(each.atom, open_) for each in literals(part) if each.positive)
    stages = (part for chain in problem.chains for stage in chain.stages for part in parts_of(stage))
    yield from (stage for stage in stages if stage.name in fluent)


def _missing(domain: Domain, true: Collection[str]) -> list[str]:
    """The fluents that operators need and that nothing makes true without them, those that most operators need first."""
    needs = {
        o.name: {each.atom.name for each in literals(o.precondition) if each.positive}
        for o in domain.operators
    }
    implied = {each.atom.name for d in domain.deductive_operators for each in d.consequences if each.implied}
    counts = Counter(name for each in needs.values() for name in each)
    found = []
    for name in counts:
        makers = [o.name for o in domain.operators if any(e.adds and e.atom.name == name for e in o.effects)]
        rooted = name not in implied and all(name in needs[each] for each in makers)
        if domain.predicates[name].kind is Kind.FLUENT and name not in true and rooted:
            found.append(name)
    return sorted(found, key=lambda name: (-counts[name], name))
