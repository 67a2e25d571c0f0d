"""Exchanges interchangeable objects in a plan so that they come in the order they are named.

A search does not care which of two probes it heats first, and takes either. The user who says
"probe 1 and probe 2" expects probe 1 first. So where objects differ in their names alone, or in the
numbers of their goals (how long each is heated), they change places in the plan that was found.
Nothing is searched: the checker tells whether the result is a plan.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.workflow_replay import STAGE_FLUENT
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import Body, Literal, goal_parts, literals_in
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.operator_amounts import NoAmount
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Term, Text, exchange_subterms

MAX_REORDERED_STEPS = 400  # steps; the order of longer plans is as it was found
LOOKED_AT = Function("*")  # stands for the object that is looked at

Moves = Mapping[Term, Term]


def canonical_object_order(semantics: Semantics, plan: Plan, fits: Callable[[Plan], bool]) -> Plan:
    """The plan in which alike objects come in the order of goals and chains, as far as it `fits`;
    else the plan itself.

    No such plan costs more or takes longer than the one that was found.
    """
    if len(plan.steps) > MAX_REORDERED_STEPS:
        return plan
    for group in _alike_objects(semantics.problem):
        served = _serving_order(plan, group)
        if len(served) == len(group) and served != group:
            moves = _exchanges(semantics, dict(zip(served, group, strict=True)))
            exchanged_plan = None if moves is None else _exchange_objects(semantics, plan, moves)
            better = exchanged_plan is not None and (
                exchanged_plan.cost,
                plan_makespan(exchanged_plan),
            ) <= (
                plan.cost,
                plan_makespan(plan),
            )
            plan = (
                exchanged_plan
                if exchanged_plan is not None and better and fits(exchanged_plan)
                else plan
            )
    return plan


def _alike_objects(problem: Problem) -> Iterator[list[Function]]:
    """Objects of one type with the same goals but for numbers, of which the same numbers are
    known, in the order of their names.
    """
    types, facts_of_object = {**problem.domain.objects, **problem.objects}, _numeric_facts(problem)
    groups: dict[tuple[object, ...], list[Function]] = {}
    for named_object, wish in _wanted_constants(problem).items():
        if named_object.name in types:
            shape = [text for text, _ in _wishes_about(wish, named_object)]
            numbers = tuple(
                sorted(
                    str(exchange_subterms(fact, {named_object: LOOKED_AT}))
                    for fact in facts_of_object.get(named_object, ())
                )
            )
            groups.setdefault((types[named_object.name], *shape, numbers), []).append(named_object)
    return (group for group in groups.values() if len(group) > 1)


def _wishes_about(
    wishes_of_object: Iterable[tuple[Atom, ...]], object_term: Function
) -> list[tuple[str, list[Number]]]:
    """What is wanted of an object, sorted: as a text without its name and without numbers, and
    these numbers.
    """
    wishes = []
    for atoms in wishes_of_object:
        numbers = [number for atom in atoms for number in _numbers_in(atom)]
        hidden: dict[Term, Term] = {object_term: LOOKED_AT, **dict.fromkeys(numbers, ANYTHING)}
        wishes.append(
            (" then ".join(str(exchange_subterms(atom, hidden)) for atom in atoms), numbers)
        )
    return sorted(wishes, key=lambda wish: (wish[0], [number.value for number in wish[1]]))


def _wanted_constants(problem: Problem) -> dict[Function, list[tuple[Atom, ...]]]:
    """The constants of the goal and of the chains in the order in which they are named, each with
    the atoms of the parts and chains that name it."""
    wishes = [chain.stages for chain in problem.chains]
    wishes += [
        tuple(literal.atom for literal in literals_in(part)) for part in goal_parts(problem.goal)
    ]
    wanted_atoms: dict[Function, list[tuple[Atom, ...]]] = {}
    for atoms in wishes:
        for named_constant in dict.fromkeys(
            constant for atom in atoms for constant in _constants_in(atom)
        ):
            wanted_atoms.setdefault(named_constant, []).append(atoms)
    return wanted_atoms


def _constants_in(term: Term) -> Iterator[Function]:
    """The constants in a term."""
    if isinstance(term, Function):
        for argument in term.arguments:
            if isinstance(argument, Function) and not argument.arguments:
                yield argument
            yield from _constants_in(argument)


def _numbers_in(term: Term) -> Iterator[Number]:
    """The numbers in a term."""
    if isinstance(term, Number):
        yield term
    elif isinstance(term, Function):
        for argument in term.arguments:
            yield from _numbers_in(argument)


def _numeric_facts(problem: Problem) -> dict[Term, list[Atom]]:
    """What the problem says about each object in numbers, such as its due time."""
    facts_told: dict[Term, list[Atom]] = {}
    for fact in (*problem.statics, *problem.initial):
        if any(isinstance(argument, Number) for argument in fact.arguments):
            for term in dict.fromkeys(fact.arguments):
                facts_told.setdefault(term, []).append(fact)
    return facts_told


def _serving_order(plan: Plan, group: Sequence[Function]) -> list[Function]:
    """The objects in the order in which the plan begins to handle them."""
    among = set(group)
    return list(
        dict.fromkeys(e for step in plan.steps for e in _constants_in(step.operator) if e in among)
    )


def _facts_about(semantics: Semantics, example: Function) -> list[Atom]:
    """What holds at the start, and the static facts that anything asks for and that can be
    about such an object.
    """
    domain, declared = semantics.problem.domain, semantics.problem.domain.predicates
    type_ = {**domain.objects, **semantics.problem.objects}[example.name]
    about = (
        name
        for name in dict.fromkeys(literal.atom.name for literal in _asked_literals(domain))
        if name in declared
        and any(domain.is_subtype(type_, argument) for argument in declared[name].arguments)
    )
    return [
        *semantics.initial(),
        *(fact for name in about for fact in semantics.statics.named(name)),
    ]


def _asked_literals(domain: Domain) -> Iterator[Literal]:
    """What operators, deductive operators and rules ask for."""
    for operator in domain.operators:
        yield from literals_in(operator.precondition)
    bodies: list[Body] = [operator.body for operator in domain.operators]
    for deductive in domain.deductive_operators:
        bodies += [deductive.body, *(consequence.body for consequence in deductive.consequences)]
    for body in (*bodies, *(rule.body for rule in domain.rules)):
        yield from (literal for part in body for literal in literals_in(part))


def _exchanges(semantics: Semantics, object_pairs: Mapping[Function, Function]) -> Moves | None:
    """What takes the place of what, so that each object finds what belongs to it; None if that
    contradicts itself.
    """
    own: dict[Term, dict[tuple[str, int], set[Atom]]] = {thing: {} for thing in object_pairs}
    for fact in _facts_about(semantics, next(iter(object_pairs))):
        for place, argument in enumerate(fact.arguments):
            if argument in own:
                own[argument].setdefault((fact.name, place), set()).add(fact)
    moves: dict[Term, Term] = {first: second for first, second in object_pairs.items()}
    wishes = _wanted_constants(semantics.problem)
    for first, second in object_pairs.items():
        pairs = [*zip(_numbers_of(wishes, first), _numbers_of(wishes, second), strict=True)]
        for key, mine in own[first].items():
            theirs = own[second].get(key, set())
            if len(mine) == len(theirs) == 1:
                pairs += zip(next(iter(mine)).arguments, next(iter(theirs)).arguments, strict=True)
        if any(moves.setdefault(source, target) != target for source, target in pairs):
            return None
    return moves if len(set(moves.values())) == len(moves) else None


def _numbers_of(
    wishes: Mapping[Function, list[tuple[Atom, ...]]], object_term: Function
) -> list[Term]:
    """The numbers in what is wanted of an object."""
    return [
        number
        for _, numbers in _wishes_about(wishes.get(object_term, ()), object_term)
        for number in numbers
    ]


def _exchange_objects(semantics: Semantics, plan: Plan, moves: Moves) -> Plan | None:
    """The plan with other terms in the places of some; None if it has a step that there is not."""
    steps: list[Step] = []
    for step in plan.steps:
        operator, resources = (
            _exchange_atom(step.operator, moves),
            tuple(exchange_subterms(resource, moves) for resource in step.resources),
        )
        binding = semantics.binding(operator)
        if isinstance(binding, str):
            return None
        try:
            duration = semantics.amounts.lasting(*binding)
            cost = semantics.amounts.of(binding[0].cost, binding[1], 1)
        except NoAmount:
            return None
        steps.append(
            replace(step, operator=operator, resources=resources, duration=duration, cost=cost)
        )
    chains = _exchanged_chains(semantics.problem, moves)
    links = []
    for link in plan.links:
        match link.condition:
            case Function(name, (Text(chain), reached)) if name == STAGE_FLUENT:
                if chain not in chains:
                    return None
                moved = Function(STAGE_FLUENT, (Text(chains[chain]), reached))
            case condition:
                moved = _exchange_atom(condition, moves)
        links.append(replace(link, condition=moved))
    return Plan(tuple(steps), tuple(links))


def _exchange_atom(term: Atom, moves: Moves) -> Atom:
    return Function(
        term.name, tuple(exchange_subterms(argument, moves) for argument in term.arguments)
    )


def _exchanged_chains(problem: Problem, moves: Moves) -> dict[str, str]:
    """For each chain the one whose stages take the places of its own, if there is one."""
    names = {chain.stages: chain.name for chain in reversed(problem.chains)}
    moved = {
        chain.name: tuple(_exchange_atom(stage, moves) for stage in chain.stages)
        for chain in problem.chains
    }
    own = {chain.name for chain in problem.chains if moved[chain.name] == chain.stages}
    return {
        name: name if name in own else names[stages]
        for name, stages in moved.items()
        if name in own or stages in names
    }
