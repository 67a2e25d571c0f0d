"""Finds places that a goal asks for and that something else takes at the start, so that people are
told that the plan moves it.
"""

from collections.abc import Iterator, Sequence, Set

from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, is_ground, sort_naturally, stage_parts


def find_taken_places(problem: Problem, plan: Plan) -> Iterator[Diagnostic]:
    """A warning for each thing that nobody named and that a plan takes away from where a goal
    puts another one.
    """
    wanted = [
        atom for atom in _wanted_atoms(problem) if len(atom.arguments) > 1 and is_ground(atom)
    ]
    if not wanted:
        return
    semantics = Semantics(problem)
    begin = semantics.initial()
    named = {argument for atom in _wanted_atoms(problem) for argument in atom.arguments}
    taken = list(_taken(wanted, named, begin))
    if not taken:  # the plan need not be replayed
        return
    end = _end(semantics, plan)
    for goal, fact, thing in taken:
        if fact in end:
            continue
        now = [
            each
            for each in sort_naturally(end)
            if each.name == fact.name and _thing(each, fact) == thing
        ]
        where = f": the plan ends with {now[0]}" if now else ": the plan takes it away"
        said = f"the place that {goal} asks for is taken at the start by {fact}{where}"
        hint = f"say where {thing} should go, if that matters"
        yield Diagnostic(
            problem.where if problem.path else Source(str(goal)),
            "K314",
            said,
            hint,
            warning=True,
        )


def _taken(
    wanted: Sequence[Atom], named: Set[Term], begin: frozenset[Atom]
) -> Iterator[tuple[Atom, Atom, Function]]:
    """Goals, each with a fact of the start that has the same place, and with the thing that nobody
    named and that is there.
    """
    facts: dict[object, list[Atom]] = {}
    for fact in begin:
        facts.setdefault((fact.name, fact.arguments[1:]), []).append(fact)
    for goal in wanted:
        if goal in begin:
            continue
        for fact in sort_naturally(facts.get((goal.name, goal.arguments[1:]), ())):
            thing = _other(fact, goal)
            if thing is not None and thing not in named:
                yield goal, fact, thing


def _wanted_atoms(problem: Problem) -> Iterator[Atom]:
    for part in goal_parts(problem.goal):
        if isinstance(part, Literal) and part.positive:
            yield part.atom
    for chain in problem.chains if problem.chains else ():
        yield from (part for stage in chain.stages for part in stage_parts(stage))


def _end(semantics: Semantics, plan: Plan) -> frozenset[Atom]:
    """What holds after a plan."""
    state = semantics.layer(semantics.initial())
    for step in plan.steps:
        bound = semantics.binding(step.operator)
        if isinstance(bound, str):
            break
        change = semantics.change(*bound, semantics.facts(state), state)
        state = state.after(change.ends, change.adds)
    return frozenset(state.atoms())


def _other(fact: Atom, goal: Atom) -> Function | None:
    """The thing of a fact that differs from a goal in its first argument alone."""
    same = fact.name == goal.name and fact.arguments[1:] == goal.arguments[1:]
    thing = fact.arguments[0] if same and fact.arguments[0] != goal.arguments[0] else None
    return thing if isinstance(thing, Function) else None


def _thing(atom: Atom, like: Atom) -> object:
    return atom.arguments[0] if len(atom.arguments) == len(like.arguments) else None
