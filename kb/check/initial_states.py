"""Warnings about initial states: two things where one fits, and goals out of reach."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import Exists, Literal, goal_parts, literals_in
from cellwright.kb.model.domain_model import DeductiveOperator, Domain, Kind, Operator
from cellwright.kb.model.planning_problem import Problem, reaches_stage
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Substitution,
    match_term,
    sort_naturally,
    stage_parts,
    substitute_atom,
    substitute_term,
    term_variables,
    unify,
)


def warn_of_crowding(
    problem: Problem, state: Collection[Atom], homes: Collection[Atom]
) -> Iterator[Diagnostic]:
    """Warnings about initial facts, and about defaults, that put two things where only one fits.

    `homes` are the instances of the defaults; those of a thing that has several are only
    possibilities.
    """
    told_groups: set[frozenset[Atom]] = set()
    for rule, room in _find_rooms(problem.domain):
        for atoms in (state, _sole_atoms(rule, room, homes)):
            for place, inside in _by_room(rule, room, atoms).items():
                if len(inside) < 2 or inside in told_groups:
                    continue
                told_groups.add(inside)
                shown = sort_naturally(inside)
                origin = "at the start" if atoms is state else "by default"
                message = (
                    f"{' and '.join(map(str, shown[:3]))} hold {origin}, but {place} allows "
                    "only one of them"
                )
                hint = (
                    "give one of them another place under `initial:`, or change what the "
                    "default reads"
                )
                yield Diagnostic(problem.where, "K314", message, hint, warning=True)


def _find_rooms(domain: Domain) -> Iterator[tuple[DeductiveOperator, Atom]]:
    """Deductive operators whose trigger takes up room: it denies an atom that each operator
    needs that adds the trigger.
    """
    for rule in domain.deductive_operators:
        if rule.trigger.positive and not rule.body:
            denied = (
                consequence.atom
                for consequence in rule.consequences
                if not consequence.implied and not consequence.body
            )
            yield from (
                (rule, room) for room in denied if _is_room(domain, rule.trigger.atom, room)
            )


def _is_room(domain: Domain, made: Atom, room: Atom) -> bool:
    """Whether an atom is room that several things could take up, of which each needs it."""
    fewer = set(term_variables(room)) < set(term_variables(made))
    return fewer and room.name != made.name and _always_needed(domain, made, room)


def _always_needed(domain: Domain, made: Atom, room: Atom) -> bool:
    makers = [
        is_needed
        for operator in domain.operators
        for is_needed in _needs_room(operator, made, room)
    ]
    return bool(makers) and all(makers)


def _needs_room(operator: Operator, made: Atom, room: Atom) -> Iterator[bool]:
    """For each effect that adds `made`: whether the operator needs the room that it takes up."""
    rename = {variable: type(variable)(f"{variable.name}_own") for variable in operator.variables}
    conditions = [
        part
        for part in goal_parts(operator.precondition)
        if isinstance(part, Literal) and part.positive
    ]
    needed = {substitute_atom(condition.atom, rename) for condition in conditions}
    for effect in operator.effects:
        bindings = unify(made, substitute_atom(effect.atom, rename), {}) if effect.adds else None
        if bindings is not None:
            yield _follow_bindings(room, bindings) in {
                _follow_bindings(atom, bindings) for atom in needed
            }


def _follow_bindings(atom: Atom, bindings: Substitution) -> Atom:
    while (after := substitute_atom(atom, bindings)) != atom:
        atom = after
    return atom


def _by_room(
    rule: DeductiveOperator, room: Atom, atoms: Collection[Atom]
) -> Mapping[Atom, frozenset[Atom]]:
    inside_by_place: dict[Atom, frozenset[Atom]] = {}
    for atom in atoms:
        bindings = match_term(rule.trigger.atom, atom, {})
        if bindings is not None:
            place = substitute_atom(room, bindings)
            inside_by_place[place] = inside_by_place.get(place, frozenset()) | {atom}
    return inside_by_place


def _sole_atoms(rule: DeductiveOperator, room: Atom, atoms: Collection[Atom]) -> list[Atom]:
    """The atoms of things that have only one of them."""
    thing_arguments = [
        argument
        for argument in rule.trigger.atom.arguments
        if not set(term_variables(argument)) <= set(term_variables(room))
    ]
    owners: dict[tuple[object, ...], list[Atom]] = {}
    for atom in atoms:
        bindings = match_term(rule.trigger.atom, atom, {})
        if bindings is not None:
            owners.setdefault(
                tuple(substitute_term(argument, bindings) for argument in thing_arguments), []
            ).append(atom)
    return [own[0] for own in owners.values() if len(own) == 1]


def warn_of_unreachable_goals(
    problem: Problem, reached: Collection[Atom], begun: bool, problems: Sequence[Problem]
) -> Iterator[Diagnostic]:
    """A warning about an initial state from which no goal of any problem can be reached, even if
    nothing were ever undone.

    `reached` are the atoms that can become true; `begun` says whether a chain of the problem can
    reach its first stage. Goals of derived predicates that grounding has replaced by what they
    stand for are not among `reached`: of them nothing is said.
    """
    wanted_fluents = {atom for problem in problems for atom in _wanted_fluents(problem)}
    derived = {
        name
        for name, predicate in problem.domain.predicates.items()
        if predicate.kind is Kind.DERIVED
    }
    if {atom.name for atom in wanted_fluents} & derived - {atom.name for atom in reached}:
        return
    own = set(_wanted_fluents(problem)) or {
        part for c in problem.chains for stage in c.stages for part in stage_parts(stage)
    }
    names = {atom.name for atom in wanted_fluents}
    possible = [atom for atom in reached if atom.name in names]
    if (
        begun
        or not own
        or any(reaches_stage(atom, fluent) for fluent in wanted_fluents for atom in possible)
    ):
        return
    missing = _missing_fluents(problem.domain, {atom.name for atom in reached})
    shown = ", ".join(
        f"{name}({', '.join(problem.domain.predicates[name].arguments)})" for name in missing[:3]
    )
    hint = (
        f"nothing is true of {shown}: add such facts under `initial:`"
        if missing
        else "`cellwright explain` tells what is missing"
    )
    elsewhere = " or of any other problem" if len(problems) > 1 else ""
    message = f"no goal of {problem.name}{elsewhere} can be reached from this initial state"
    yield Diagnostic(problem.where, "K313", message, hint, warning=True)


def _wanted_fluents(problem: Problem) -> Iterator[Atom]:
    """The fluents that a problem asks for, as goals or stages; `_` stands for any value."""
    fluent = {
        name
        for name, predicate in problem.domain.predicates.items()
        if predicate.kind is not Kind.EVENT
    }
    for part in goal_parts(problem.goal):
        open_ = {p.variable: ANYTHING for p in part.parameters} if isinstance(part, Exists) else {}
        yield from (
            substitute_atom(literal.atom, open_)
            for literal in literals_in(part)
            if literal.positive
        )
    stages = (
        part for chain in problem.chains for stage in chain.stages for part in stage_parts(stage)
    )
    yield from (stage for stage in stages if stage.name in fluent)


def _missing_fluents(domain: Domain, true: Collection[str]) -> list[str]:
    """The fluents that operators need and that nothing makes true without them, those that most
    operators need first.
    """
    needs = {
        o.name: {literal.atom.name for literal in literals_in(o.precondition) if literal.positive}
        for o in domain.operators
    }
    implied = {
        consequence.atom.name
        for d in domain.deductive_operators
        for consequence in d.consequences
        if consequence.implied
    }
    counts = Counter(name for operator_needs in needs.values() for name in operator_needs)
    missing = []
    for name in counts:
        makers = [
            o.name
            for o in domain.operators
            if any(e.adds and e.atom.name == name for e in o.effects)
        ]
        rooted = name not in implied and all(name in needs[maker] for maker in makers)
        if domain.predicates[name].kind is Kind.FLUENT and name not in true and rooted:
            missing.append(name)
    return sorted(missing, key=lambda name: (-counts[name], name))
