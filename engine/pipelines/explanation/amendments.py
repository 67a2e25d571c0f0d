"""Makes changed problems: facts, objects, goals and events added, removed or replaced."""

from collections.abc import Collection, Iterator
from dataclasses import replace

from cellwright.engine.model.plan_explanation import Amendment, Edit
from cellwright.kb.asp import Grounder
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Atom, Function, Term

STATIC, INITIAL, OBJECT = "static", "initial", "object"


def apply_amendment(problem: Problem, change: Amendment) -> Problem:
    """The problem with a change made."""
    for edit in change.edits:
        problem = apply_edit(problem, edit)
    asked = tuple(Chain(str(stage), (stage,)) for stage in change.stages)
    problem = replace(problem, chains=(*problem.chains, *asked))
    return without_goal(problem, change.goal) if change.goal else problem


def apply_edit(problem: Problem, edit: Edit) -> Problem:
    """The problem with one fact different."""
    if edit.removed is not None:
        problem = _WITHOUT[edit.layer](problem, edit.removed, edit.added is not None)
    if edit.added is None:
        return problem
    match edit.layer:
        case "static":
            return replace(problem, statics=(*problem.statics, edit.added))
        case "initial":
            return replace(problem, initial=(*problem.initial, edit.added))
        case _:
            return replace(
                problem, objects={**problem.objects, str(edit.added.arguments[0]): edit.added.name}
            )


def domain_facts(domain: Domain) -> dict[int, tuple[Atom, ...]]:
    """For each statement of the domain that is a fact, by its number, the atoms that it stands
    for.
    """
    plain = [
        n
        for n, rule in enumerate(domain.asp)
        if not (rule.body or rule.is_constraint or rule.constant)
    ]
    constants = [rule.text for rule in domain.asp if rule.constant]
    grounder = Grounder()
    grounder.ground("\n".join([*constants, *(f"_fact({n}, {domain.asp[n].head})." for n in plain)]))
    facts_of_rules: dict[int, list[Atom]] = {}
    for number, atom in grounder.atoms("_fact", 2):
        if isinstance(atom, Function):
            facts_of_rules.setdefault(int(str(number)), []).append(atom)
    return {
        number: tuple(sorted(atoms, key=str)) for number, atoms in sorted(facts_of_rules.items())
    }


def _without_static(problem: Problem, fact: Atom, _replaced: bool) -> Problem:
    """A fact in a statement for many facts leaves the others behind, as statics of the problem."""
    domain, statics = problem.domain, tuple(static for static in problem.statics if static != fact)
    for number, atoms in reversed(domain_facts(domain).items()):
        if fact in atoms:
            asp = (*domain.asp[:number], *domain.asp[number + 1 :])
            domain = replace(domain, asp=asp)
            statics += tuple(atom for atom in atoms if atom != fact)
    return replace(problem, domain=domain, statics=statics)


def _without_initial(problem: Problem, fact: Atom, _replaced: bool) -> Problem:
    return replace(
        problem,
        initial=tuple(initial_atom for initial_atom in problem.initial if initial_atom != fact),
    )


def _without_object(problem: Problem, fact: Atom, replaced: bool) -> Problem:
    """An object that is gone takes the problem's facts about it along; one that only changes
    its type does not.
    """
    name = fact.arguments[0]
    objects, own = (
        {
            name_of_object: type_
            for name_of_object, type_ in types_of_objects.items()
            if name_of_object != str(name)
        }
        for types_of_objects in (problem.domain.objects, problem.objects)
    )
    problem = replace(problem, domain=replace(problem.domain, objects=objects), objects=own)
    if replaced:
        return problem
    statics, initial = (
        tuple(fact for fact in facts if name not in terms_within(fact))
        for facts in (problem.statics, problem.initial)
    )
    return replace(problem, statics=statics, initial=initial)


_WITHOUT = {STATIC: _without_static, INITIAL: _without_initial, OBJECT: _without_object}


def terms_within(term: Term) -> Iterator[Term]:
    """The term and everything inside it."""
    yield term
    if isinstance(term, Function):
        for argument in term.arguments:
            yield from terms_within(argument)


def without_goal(problem: Problem, goal: str) -> Problem:
    """The problem without a conjunct of its goal or a chain, named by its text."""
    parts = tuple(part for part in goal_parts(problem.goal) if str(part) != goal)
    dropped = {
        chain.name for chain in problem.chains if chain_text(chain.name, chain.stages) == goal
    }
    return replace(problem, goal=And(parts), chains=without_chains(problem.chains, dropped))


def without_chains(chains: Collection[Chain], dropped: Collection[str]) -> tuple[Chain, ...]:
    """The other chains. What waited for a dropped chain waits for what that one waited for."""
    after = {chain.name: chain.after for chain in chains}

    def kept(names: Collection[str], seen: frozenset[str] = frozenset()) -> Iterator[str]:
        for name in names:
            if name not in dropped:
                yield name
            elif name not in seen:
                yield from kept(after.get(name, ()), seen | {name})

    return tuple(
        replace(chain, after=tuple(dict.fromkeys(kept(chain.after))))
        for chain in chains
        if chain.name not in dropped
    )


def chain_text(name: str, stages: tuple[Atom, ...]) -> str:
    """A chain in words."""
    return f"{', '.join(map(str, stages))} (workflow {name})"
