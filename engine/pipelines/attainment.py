"""What can still be reached when not all goals can: the goals that are kept, and those that are given up, each with the reason.

Goals are conjuncts of the goal, and chains up to one of their stages. A chain that is cut keeps the stages before the first
one that cannot be reached; a chain that waits for another one no longer waits if that one is given up.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from engine.model.outcome import Found, Infeasible, Outcome
from engine.pipelines import planning
from engine.stages.grounding import ground
from engine.stages.planning import Limits
from engine.stages.planning import plan as plan_task
from kb.model.conditions import And, Condition, goal_parts
from kb.model.problem import Chain, Problem

NOTHING_MORE = "no goal that is still open can be reached"
IN_ANY_CASE = "it cannot be reached from this state, whatever is done"


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Something that may keep goals from being reached: what it is, and the problem as it would be without it."""

    why: str
    without: Problem


@dataclass(frozen=True, slots=True)
class GivenUp:
    """A goal that is not planned for, and why."""

    goal: str
    why: str


@dataclass(frozen=True, slots=True)
class Attainable:
    """The problem with the goals that can be reached, the answer for it, and the goals that are given up."""

    problem: Problem
    outcome: Outcome
    given_up: tuple[GivenUp, ...] = ()


@dataclass(frozen=True, slots=True)
class Part:
    """A conjunct of the goal, or a chain up to one of its stages."""

    condition: Condition | None = None
    chain: Chain | None = None
    stages: int = 0

    def cut(self, stages: int) -> "Part":
        """The chain up to fewer stages."""
        return replace(self, stages=stages)


def attainable(
    problem: Problem,
    obstacles: Sequence[Obstacle] = (),
    free: Problem | None = None,
    limits: Limits = Limits(),
    outcome: Outcome | None = None,
) -> Attainable:
    """A plan for as many goals as can be reached, in the order in which they are named. Raises `InvalidInput`.

    `free` is the problem without any obstacle; `outcome` is the answer for all goals, if it is known already.

    No plan exists if no goal that is still open can be reached. A search that gives up proves nothing: its answer is passed
    on, and no goal is given up for it.
    """
    outcome = outcome or planning.plan(problem, limits)
    if not isinstance(outcome, Infeasible):
        return Attainable(problem, outcome)
    search = _Search(problem, obstacles, free, limits)
    wanted = search.parts()
    alone = [search.alone(part) for part in wanted]
    kept = search.together([part for part in alone if part is not None])
    given_up = tuple(search.given_up(wanted, alone, kept))
    left = search.only(kept)
    found = planning.plan(left, limits) if kept else outcome
    if not kept or (isinstance(found, Found) and not found.plan.steps):
        return Attainable(problem, replace(outcome, reason=NOTHING_MORE), given_up)
    return Attainable(left, found, given_up)


@dataclass(frozen=True)
class _Search:
    problem: Problem
    obstacles: Sequence[Obstacle]
    free: Problem | None
    limits: Limits

    def parts(self) -> list[Part]:
        """All goals, whole."""
        conjuncts = [Part(condition=each) for each in goal_parts(self.problem.goal)]
        return conjuncts + [Part(chain=each, stages=len(each.stages)) for each in self.problem.chains]

    def only(self, parts: Iterable[Part], among: Problem | None = None) -> Problem:
        """The problem with some of its goals alone."""
        problem = among or self.problem
        lengths = {part.chain.name: part.stages for part in parts if part.chain is not None}
        whole = {c.name for c in problem.chains if lengths.get(c.name) == len(c.stages)}
        chains = tuple(
            replace(
                chain,
                stages=chain.stages[: lengths[chain.name]],
                after=tuple(name for name in chain.after if name in whole),
            )
            for chain in problem.chains
            if chain.name in lengths
        )
        goal = And(tuple(part.condition for part in parts if part.condition is not None))
        return replace(problem, goal=goal, chains=chains)

    def alone(self, part: Part) -> Part | None:
        """As much of a goal as can be reached if nothing else is wanted; None if that is nothing."""
        return self._longest([], part)

    def together(self, parts: list[Part]) -> list[Part]:
        """Goals that can be reached together: all of them, else one after the other is added as far as it goes."""
        if not parts or not self._infeasible(self.only(parts)):
            return parts
        kept: list[Part] = []
        for part in parts:
            longest = self._longest(kept, part)
            kept += [longest] if longest is not None else []
        return kept

    def given_up(
        self, wanted: Sequence[Part], alone: Sequence[Part | None], kept: Sequence[Part]
    ) -> Iterator[GivenUp]:
        """What is not kept of each goal, with the reason."""
        for whole, reachable in zip(wanted, alone, strict=True):
            final = next((k for k in kept if (k.condition, k.chain) == (whole.condition, whole.chain)), None)
            if final == whole:
                continue
            first = _next(whole, final)
            reason = self._reason(first) if final == reachable else _rivals(kept, whole)
            yield GivenUp(_name(first), reason)
            if whole.chain is not None:
                last = whole.chain.stages[first.stages - 1]
                for stage in whole.chain.stages[first.stages :]:
                    yield GivenUp(f"{stage} of {whole.chain.name}", f"it comes after {last}")

    def _longest(self, others: Sequence[Part], part: Part) -> Part | None:
        if part.chain is None:
            return None if self._infeasible(self.only([*others, part])) else part
        cuts = (part.cut(stages) for stages in range(part.stages, 0, -1))
        return next((cut for cut in cuts if not self._infeasible(self.only([*others, cut]))), None)

    def _reason(self, part: Part) -> str:
        """The obstacles without one of which a goal could be reached; all of them if only they together hinder it."""
        if self.free is not None and self._infeasible(self.only([part], self.free)):
            return IN_ANY_CASE
        found = [o.why for o in self.obstacles if not self._infeasible(self.only([part], o.without))]
        reasons = found or [each.why for each in self.obstacles]
        return "; ".join(dict.fromkeys(reasons)) or IN_ANY_CASE

    def _infeasible(self, problem: Problem) -> bool:
        return isinstance(plan_task(ground(problem), replace(self.limits, improvement=0)), Infeasible)


def _next(whole: Part, final: Part | None) -> Part:
    """The first thing of a goal that is given up: the goal, or its chain up to the first stage that is not kept."""
    return whole if whole.chain is None else whole.cut((final.stages if final else 0) + 1)


def _name(part: Part) -> str:
    if part.chain is None:
        return str(part.condition)
    return f"{part.chain.stages[part.stages - 1]} of {part.chain.name}"


def _rivals(kept: Sequence[Part], whole: Part) -> str:
    others = ", ".join(_name(each) for each in kept if each.chain is not whole.chain or whole.chain is None)
    return f"it cannot be reached together with {others}"
