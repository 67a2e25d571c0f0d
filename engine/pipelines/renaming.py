"""Whose turn it is first: objects that are alike are served in the order in which the user names them.

A search does not care which of two probes it heats first, and takes either. The user who says "probe 1 and probe 2" expects
probe 1 first. So where objects differ in their names alone, or in the numbers of their goals (how long each is heated), they
change places in the plan that was found. Nothing is searched: the checker tells whether the result is a plan.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from cellwright.engine.model.forecast import makespan
from cellwright.engine.model.stages import STAGE
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.amounts import NoAmount
from cellwright.kb.model.conditions import Body, Literal, goal_parts, literals
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Term, Text, exchanged

LONG = 400  # steps; the order of longer plans is as it was found
HERE = Function("*")  # stands for the object that is looked at

Moves = Mapping[Term, Term]


def in_the_order_said(semantics: Semantics, plan: Plan, fits: Callable[[Plan], bool]) -> Plan:
    """The plan in which alike objects come in the order of goals and chains, as far as it `fits`; else the plan itself.

    No such plan costs more or takes longer than the one that was found.
    """
    if len(plan.steps) > LONG:
        return plan
    for group in _alike(semantics.problem):
        served = _served(plan, group)
        if len(served) == len(group) and served != group:
            moves = _moves(semantics, dict(zip(served, group, strict=True)))
            other = None if moves is None else _moved(semantics, plan, moves)
            better = other is not None and (other.cost, makespan(other)) <= (plan.cost, makespan(plan))
            plan = other if other is not None and better and fits(other) else plan
    return plan


def _alike(problem: Problem) -> Iterator[list[Function]]:
    """Objects of one type with the same goals but for numbers, of which the same numbers are known, in the order of their names."""
    types, told = {**problem.domain.objects, **problem.objects}, _told(problem)
    groups: dict[tuple[object, ...], list[Function]] = {}
    for each, wanted in _wanted(problem).items():
        if each.name in types:
            shape = [said for said, _ in _about(wanted, each)]
            numbers = tuple(sorted(str(exchanged(fact, {each: HERE})) for fact in told.get(each, ())))
            groups.setdefault((types[each.name], *shape, numbers), []).append(each)
    return (group for group in groups.values() if len(group) > 1)


def _about(wanted: Iterable[tuple[Atom, ...]], thing: Function) -> list[tuple[str, list[Number]]]:
    """What is wanted of an object, sorted: as a text without its name and without numbers, and these numbers."""
    found = []
    for atoms in wanted:
        numbers = [each for atom in atoms for each in _counts(atom)]
        hidden: dict[Term, Term] = {thing: HERE, **dict.fromkeys(numbers, ANYTHING)}
        found.append((" then ".join(str(exchanged(atom, hidden)) for atom in atoms), numbers))
    return sorted(found, key=lambda each: (each[0], [number.value for number in each[1]]))


def _wanted(problem: Problem) -> dict[Function, list[tuple[Atom, ...]]]:
    """The constants of the goal and of the chains in the order in which they are named, each with the atoms of the parts and
    chains that name it."""
    wishes = [chain.stages for chain in problem.chains]
    wishes += [tuple(literal.atom for literal in literals(part)) for part in goal_parts(problem.goal)]
    found: dict[Function, list[tuple[Atom, ...]]] = {}
    for atoms in wishes:
        for each in dict.fromkeys(constant for atom in atoms for constant in _constants(atom)):
            found.setdefault(each, []).append(atoms)
    return found


def _constants(term: Term) -> Iterator[Function]:
    """The constants in a term."""
    if isinstance(term, Function):
        for each in term.arguments:
            if isinstance(each, Function) and not each.arguments:
                yield each
            yield from _constants(each)


def _counts(term: Term) -> Iterator[Number]:
    """The numbers in a term."""
    if isinstance(term, Number):
        yield term
    elif isinstance(term, Function):
        for each in term.arguments:
            yield from _counts(each)


def _told(problem: Problem) -> dict[Term, list[Atom]]:
    """What the problem says about each object in numbers, such as its due time."""
    found: dict[Term, list[Atom]] = {}
    for fact in (*problem.statics, *problem.initial):
        if any(isinstance(each, Number) for each in fact.arguments):
            for thing in dict.fromkeys(fact.arguments):
                found.setdefault(thing, []).append(fact)
    return found


def _served(plan: Plan, group: Sequence[Function]) -> list[Function]:
    """The objects in the order in which the plan begins to handle them."""
    among = set(group)
    return list(dict.fromkeys(e for step in plan.steps for e in _constants(step.operator) if e in among))


def _facts(semantics: Semantics, example: Function) -> list[Atom]:
    """What holds at the start, and the static facts that anything asks for and that can be about such an object."""
    domain, known = semantics.problem.domain, semantics.problem.domain.predicates
    type_ = {**domain.objects, **semantics.problem.objects}[example.name]
    about = (
        name
        for name in dict.fromkeys(each.atom.name for each in _asked(domain))
        if name in known and any(domain.is_subtype(type_, argument) for argument in known[name].arguments)
    )
    return [*semantics.initial(), *(fact for name in about for fact in semantics.statics.named(name))]


def _asked(domain: Domain) -> Iterator[Literal]:
    """What operators, deductive operators and rules ask for."""
    for operator in domain.operators:
        yield from literals(operator.precondition)
    bodies: list[Body] = [operator.body for operator in domain.operators]
    for deductive in domain.deductive_operators:
        bodies += [deductive.body, *(each.body for each in deductive.consequences)]
    for body in (*bodies, *(rule.body for rule in domain.rules)):
        yield from (literal for part in body for literal in literals(part))


def _moves(semantics: Semantics, things: Mapping[Function, Function]) -> Moves | None:
    """What takes the place of what, so that each object finds what belongs to it; None if that contradicts itself."""
    own: dict[Term, dict[tuple[str, int], set[Atom]]] = {each: {} for each in things}
    for fact in _facts(semantics, next(iter(things))):
        for place, argument in enumerate(fact.arguments):
            if argument in own:
                own[argument].setdefault((fact.name, place), set()).add(fact)
    moves: dict[Term, Term] = {one: other for one, other in things.items()}
    wanted = _wanted(semantics.problem)
    for one, other in things.items():
        pairs = [*zip(_numbers_of(wanted, one), _numbers_of(wanted, other), strict=True)]
        for key, mine in own[one].items():
            theirs = own[other].get(key, set())
            if len(mine) == len(theirs) == 1:
                pairs += zip(next(iter(mine)).arguments, next(iter(theirs)).arguments, strict=True)
        if any(moves.setdefault(here, there) != there for here, there in pairs):
            return None
    return moves if len(set(moves.values())) == len(moves) else None


def _numbers_of(wanted: Mapping[Function, list[tuple[Atom, ...]]], thing: Function) -> list[Term]:
    """The numbers in what is wanted of an object."""
    return [number for _, numbers in _about(wanted.get(thing, ()), thing) for number in numbers]


def _moved(semantics: Semantics, plan: Plan, moves: Moves) -> Plan | None:
    """The plan with other terms in the places of some; None if it has a step that there is not."""
    steps: list[Step] = []
    for step in plan.steps:
        operator, held = _atom(step.operator, moves), tuple(exchanged(each, moves) for each in step.resources)
        found = semantics.binding(operator)
        if isinstance(found, str):
            return None
        try:
            duration = semantics.amounts.lasting(*found)
            cost = semantics.amounts.of(found[0].cost, found[1], 1)
        except NoAmount:
            return None
        steps.append(replace(step, operator=operator, resources=held, duration=duration, cost=cost))
    chains = _chains(semantics.problem, moves)
    links = []
    for link in plan.links:
        match link.condition:
            case Function(name, (Text(chain), reached)) if name == STAGE:
                if chain not in chains:
                    return None
                moved = Function(STAGE, (Text(chains[chain]), reached))
            case condition:
                moved = _atom(condition, moves)
        links.append(replace(link, condition=moved))
    return Plan(tuple(steps), tuple(links))


def _atom(term: Atom, moves: Moves) -> Atom:
    return Function(term.name, tuple(exchanged(each, moves) for each in term.arguments))


def _chains(problem: Problem, moves: Moves) -> dict[str, str]:
    """For each chain the one whose stages take the places of its own, if there is one."""
    names = {chain.stages: chain.name for chain in reversed(problem.chains)}
    moved = {chain.name: tuple(_atom(stage, moves) for stage in chain.stages) for chain in problem.chains}
    own = {chain.name for chain in problem.chains if moved[chain.name] == chain.stages}
    return {
        name: name if name in own else names[each]
        for name, each in moved.items()
        if name in own or each in names
    }
