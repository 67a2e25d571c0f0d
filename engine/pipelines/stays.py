"""Which things a plan has stay where nothing may stay for long, and which of them stay too long at given times."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.model.stays import Overstay, Stay
from cellwright.engine.stages.macros.lifted.execution import changes_of
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.scheduling.blocks import mentions
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Term

NOTHING: Mapping[Atom, int] = {}


def overstays(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int], longest: Mapping[Term, int], known: Semantics
) -> tuple[Overstay, ...]:
    """What stays too long when the steps of a plan that is right start at these times, from the end of the step that brings it."""
    if not longest:
        return ()
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    here = Situation.of(CellDomain(problem), known.initial())
    found = (
        Overstay(each.thing, each.place, starts[each.target] - ends[each.source], each.most)
        for each in stays_of(plan, longest, here)
    )
    return tuple(dict.fromkeys(each for each in found if each.lasts > each.most))


def stays_of(
    plan: Plan, longest: Mapping[Term, int], here: Situation, since: Mapping[Atom, int] = NOTHING
) -> Iterator[Stay]:
    """Which step brings something to a place where it may not stay for long, and which one takes it away.

    What is there already counts from when it came, as far as that is known.
    """
    if not longest:
        return
    brought = {atom: StepId(0) for atom in since if atom in here.state}
    for step, change in zip(plan.steps, changes_of(here, plan.steps), strict=True):
        for atom in change.ends:
            if atom in brought:
                source = brought.pop(atom)
                came = None if int(source) else since[atom]
                for each in _limits(atom, longest):
                    yield Stay(source, step.id, each.most, came, each.thing, each.place)
        brought |= dict.fromkeys(change.adds, step.id)


@dataclass(frozen=True, slots=True)
class _Limit:
    thing: str
    place: str
    most: int


def _limits(atom: Atom, longest: Mapping[Term, int]) -> Iterator[_Limit]:
    """How long a fact may last that says where something is, in a place where nothing may stay for long."""
    for place, most in longest.items():
        inside = [mentions(each, place) for each in atom.arguments]
        if any(inside) and not all(inside):
            things = (each for each, is_place in zip(atom.arguments, inside, strict=True) if not is_place)
            yield _Limit(", ".join(map(str, things)), str(place), most)
