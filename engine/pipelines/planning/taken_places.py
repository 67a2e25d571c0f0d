"""Finds places that a goal asks for and that something else takes at the start, so that people are
told that the plan moves it.
"""

from collections.abc import Iterator

from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.conditions import Literal, goal_parts
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, is_ground, sort_naturally, stage_parts


def find_taken_places(problem: Problem, plan: Plan) -> Iterator[Diagnostic]:
    """A warning for each thing that nobody named and that a plan takes away from where a goal
    puts another one.
    """
    wanted = [atom for atom in _wanted(problem) if len(atom.arguments) > 1 and is_ground(atom)]
    if not wanted:
        return
    semantics = Semantics(problem)
    begin = semantics.initial()
    end = _end(semantics, plan)
    named = {argument for atom in _wanted(problem) for argument in atom.arguments}
    for goal in wanted:
        for fact in sort_naturally(begin - end):
            if (thing := _other(fact, goal)) is None or thing in named or goal in begin:
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


def _wanted(problem: Problem) -> Iterator[Atom]:
    for part in goal_parts(problem.goal):
        if isinstance(part, Literal) and part.positive:
            yield part.atom
    for chain in problem.chains if problem.chains else ():
        yield from (part for stage in chain.stages for part in stage_parts(stage))


def _end(semantics: Semantics, plan: Plan) -> frozenset[Atom]:
    """What holds after a plan."""
    state = semantics.initial()
    for step in plan.steps:
        bound = semantics.binding(step.operator)
        if isinstance(bound, str):
            return state
        change = semantics.change(*bound, semantics.facts(state), state)
        state = (state - change.ends) | change.adds
    return state


def _other(fact: Atom, goal: Atom) -> Function | None:
    """The thing of a fact that differs from a goal in its first argument alone."""
    same = fact.name == goal.name and fact.arguments[1:] == goal.arguments[1:]
    thing = fact.arguments[0] if same and fact.arguments[0] != goal.arguments[0] else None
    return thing if isinstance(thing, Function) else None


def _thing(atom: Atom, like: Atom) -> object:
    return atom.arguments[0] if len(atom.arguments) == len(like.arguments) else None
