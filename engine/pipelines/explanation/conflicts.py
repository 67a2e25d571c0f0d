"""Why no step reaches a goal, though each thing that it needs may be had: the fewest of them that never hold together."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.pipelines.explanation.causes import Cause, causes, company
from cellwright.engine.pipelines.explanation.culprits import Goal, only
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import And, BodyPart, Literal
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, parts_of

FEW = 3  # steps that would reach a goal; of more of them, nobody wants to read each reason
MOST_NEEDS = 24

Infeasible = Callable[[Problem], bool]


def conflicts(problem: Problem, goal: Goal, space: Space, infeasible: Infeasible) -> Iterator[str]:
    """For each step that would reach the goal: what it needs and never has at once, in words. Nothing if one need is out of reach."""
    atoms, before = _last(problem, goal)
    semantics = Semantics(problem)
    for atom in atoms:
        found = list(itertools.islice(causes(semantics, atom), FEW + 1))
        if len(found) <= FEW:
            for cause in found:
                if not any(map(space.misses, cause.atoms)):
                    yield from _told(_Needs.of(semantics, cause), before, infeasible)


def _last(problem: Problem, goal: Goal) -> tuple[tuple[Atom, ...], Problem]:
    """What is to be made true at the end of a goal, and the problem that asks for all that comes before it."""
    if goal.chain:
        chain = next(each for each in problem.chains if each.name == goal.chain)
        before = [replace(goal, stages=goal.stages - 1)] if goal.stages > 1 else []
        return parts_of(chain.stages[goal.stages - 1]), only(problem, before)
    atom = goal.condition
    return ((atom.atom,) if isinstance(atom, Literal) and atom.positive else ()), only(problem, [])


@dataclass(frozen=True, slots=True)
class _Needs:
    """What a step needs. `because` has the event that must not occur for each need that nothing but that asks for."""

    cause: Cause
    parts: tuple[BodyPart, ...]
    because: tuple[tuple[BodyPart, Atom], ...]

    @classmethod
    def of(cls, semantics: Semantics, cause: Cause) -> "_Needs":
        """The needs of a step: its preconditions, and that it lets nothing happen that no workflow asks for."""
        asked = {stage for chain in semantics.problem.chains for stage in chain.stages}
        kept = {
            replace(each.when[0], positive=not each.when[0].positive): each.event
            for each in company(semantics, cause)
            if each.event not in asked and len(each.when) == 1 and isinstance(each.when[0], Literal)
        }
        parts: dict[BodyPart, None] = dict.fromkeys((*cause.needs, *kept))
        return cls(cause, tuple(parts), tuple((need, kept[need]) for need in kept if need not in cause.needs))


def _told(needs: _Needs, before: Problem, infeasible: Infeasible) -> Iterator[str]:
    kept = list(needs.parts)
    if len(kept) > MOST_NEEDS or not infeasible(_asking(before, kept)):
        return
    for each in needs.parts:
        rest = [other for other in kept if other != each]
        if rest and infeasible(_asking(before, rest)):
            kept = rest
    if len(kept) > 1:
        reasons = [f"no workflow asks for {event}" for need, event in needs.because if need in kept]
        *others, last = map(str, kept)
        said = f"{needs.cause.name} needs {', '.join(others)} and {last}, which never hold together"
        yield f"{said}: {' and '.join(reasons)}" if reasons else said


def _asking(problem: Problem, parts: Sequence[BodyPart]) -> Problem:
    return replace(problem, goal=And(tuple(parts)))
