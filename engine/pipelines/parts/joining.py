"""The steps of all parts as one plan, with the causal links between them."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from engine.stages.macros.lifted.facts import Facts
from engine.stages.macros.lifted.ground_steps import Needed
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.support import support
from engine.stages.macros.lifted.world import CellDomain
from kb.model.conditions import Literal
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.terms import Atom, Function, match


def joined(start: Situation, steps: Sequence[Step], goals: Iterable[Literal]) -> Plan:
    """The plan of the steps, one after another, with a link for each condition of a step that names its atoms."""
    world, facts = start.world, start.facts
    made: list[Step] = []
    links: list[CausalLink] = []
    last: dict[Atom, StepId] = {}
    for number, step in enumerate(steps, 1):
        own = StepId(number)
        made.append(replace(step, id=own, after=(StepId(number - 1),) if made else ()))
        known = world.ground_step(step.operator)
        if known is None:
            needed = _supports(world, step.operator, facts)
            change = world.change(step.operator, facts)
            adds, ends = change.adds, change.ends
        else:
            needed = _conditions(known.alternatives, facts)
            adds, ends = known.adds, known.ended(facts, world.statics)
        links += [CausalLink(last.get(each, START), each, own) for each in needed]
        last.update((atom, own) for atom in adds)
        last.update((Function("not", (atom,)), own) for atom in ends)
        facts = facts.after(ends, adds)
    reached = (atom for goal in goals for atom in _reaching(goal, facts))
    links += [CausalLink(last.get(atom, START), atom, GOAL) for atom in reached]
    return Plan(tuple(made), tuple(links))


def _conditions(alternatives: Sequence[Needed], facts: Facts) -> Iterator[Atom]:
    """The conditions of the first alternative that holds."""
    for holding, absent in alternatives:
        if all(atom in facts for atom in holding) and not any(atom in facts for atom in absent):
            yield from holding
            yield from (Function("not", (atom,)) for atom in absent)
            return


def _supports(world: CellDomain, step: Function, facts: Facts) -> Iterator[Atom]:
    """What the first alternative of a step's condition that holds rests on, through the rules of derived predicates."""
    schema, bindings = world.binding(step)
    found = (support(body, world, facts, bindings) for body in schema.alternatives)
    yield from dict.fromkeys(next((each for each in found if each is not None), ()))


def _reaching(goal: Literal, facts: Facts) -> Iterator[Atom]:
    """The first atom that a goal asks for, if it asks for one."""
    if goal.positive:
        found = (atom for atom in facts.matching(goal.atom) if match(goal.atom, atom, {}) is not None)
        yield from itertools.islice(found, 1)
