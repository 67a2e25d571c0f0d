"""What can still be reached when not all goals can: the goals that are kept, and those that are given up, each with the reason.

Goals are conjuncts of the goal, one for each object where it is about all, and chains up to one of their stages. A chain that is cut keeps the stages before the first
one that cannot be reached; a chain that waits for another one no longer waits if that one is given up.
An event occurs only as a stage of a chain. So what can be reached by itself is asked with the events of all chains allowed, and what
needs an event of a chain is tried again once that chain is kept.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.task import Task
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.each import for_each
from cellwright.engine.stages.grounding import ground, ground_parts, separable
from cellwright.engine.stages.grounding.goals import Parted
from cellwright.engine.stages.planning import Limits
from cellwright.engine.stages.planning import plan as plan_task
from cellwright.kb.model.conditions import And, Condition, goal_parts
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.model.workflow import allowed, events_of

NOTHING_MORE = "no goal that is still open can be reached"
IN_ANY_CASE = "it cannot be reached from this state, whatever is done"
NO_EVENT = "it needs an event of a workflow that is given up"
KEPT = 16  # ground tasks

Planner = Callable[[Problem, Limits], Outcome]
Removed = frozenset[int] | None  # obstacles without which a problem is looked at; None: as it was given


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What may keep goals from being reached: what each of them is, and the problem as it would be without some of them."""

    reasons: tuple[str, ...]
    without: Callable[[frozenset[int]], Problem]


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
    obstacles: Obstacles | None = None,
    limits: Limits = Limits(),
    outcome: Outcome | None = None,
    planner: Planner = planning.plan,
) -> Attainable:
    """A plan for as many goals as can be reached, in the order in which they are named. Raises `InvalidInput`.

    `outcome` is the answer for all goals, if it is known already. `planner` answers whole problems.

    No plan exists if no goal that is still open can be reached. A search that gives up proves nothing: its answer is passed
    on, and no goal is given up for it.
    """
    outcome = outcome or planner(problem, limits)
    if not isinstance(outcome, Infeasible):
        return Attainable(problem, outcome)
    problem = for_each(problem)
    search = _Search(problem, obstacles, limits)
    wanted = search.parts()
    alone = [search.alone(part) for part in wanted]
    kept = search.together([part for part in alone if part is not None])
    given_up = tuple(search.given_up(wanted, alone, kept))
    left = search.only(kept)
    found = planner(left, limits) if kept else outcome
    if not kept or (isinstance(found, Found) and not found.plan.steps):
        return Attainable(problem, replace(outcome, reason=NOTHING_MORE), given_up)
    return Attainable(left, found, given_up)


@dataclass(frozen=True)
class _Search:
    problem: Problem
    obstacles: Obstacles | None
    limits: Limits
    grounded: dict[Removed, Parted] = field(default_factory=dict)

    @cached_property
    def _separable(self) -> bool:
        return separable(self.problem)

    @cached_property
    def _with_events(self) -> frozenset[str]:
        """The chains of which some stage is an event."""
        domain = self.problem.domain
        return frozenset(each.name for each in self.problem.chains if events_of(each, domain))

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
        """As much of a goal as can be reached if nothing else is wanted, and all events may occur; None if that is nothing."""
        return self._longest([], part, free=True)

    def together(self, parts: list[Part]) -> list[Part]:
        """Goals that can be reached together: all of them, else one after the other is added as far as it goes."""
        if not parts or not self._infeasible(parts):
            return parts
        kept: dict[int, Part] = {}
        while True:
            before = dict(kept)
            for number, part in enumerate(parts):
                if kept.get(number) != part:
                    others = [each for other, each in kept.items() if other != number]
                    longest = self._longest(others, part)
                    kept |= {} if longest is None else {number: longest}
            if kept == before or not self._with_events:  # a goal may need an event of a later chain
                return [kept[number] for number in sorted(kept)]

    def given_up(
        self, wanted: Sequence[Part], alone: Sequence[Part | None], kept: Sequence[Part]
    ) -> Iterator[GivenUp]:
        """What is not kept of each goal, with the reason."""
        for whole, reachable in zip(wanted, alone, strict=True):
            final = next((k for k in kept if (k.condition, k.chain) == (whole.condition, whole.chain)), None)
            if final == whole:
                continue
            first = _next(whole, final)
            reason = self._reason(first) if final == reachable else self._rivals(kept, whole, first)
            yield GivenUp(_name(first), reason)
            if whole.chain is not None:
                last = whole.chain.stages[first.stages - 1]
                for stage in whole.chain.stages[first.stages :]:
                    yield GivenUp(f"{stage} of {whole.chain.name}", f"it comes after {last}")

    def _longest(self, others: Sequence[Part], part: Part, free: bool = False) -> Part | None:
        if part.chain is None:
            return None if self._infeasible([*others, part], free=free) else part
        cuts = (part.cut(stages) for stages in range(part.stages, 0, -1))
        return next((cut for cut in cuts if not self._infeasible([*others, cut], free=free)), None)

    def _rivals(self, kept: Sequence[Part], whole: Part, first: Part) -> str:
        """Why a goal that can be reached by itself is not among those that are kept."""
        moved = any(each.chain is not None and each.chain.name in self._with_events for each in kept)
        if not moved and self._infeasible([first]):
            return NO_EVENT
        others = (each for each in kept if each.chain is not whole.chain or whole.chain is None)
        return f"it cannot be reached together with {', '.join(map(_name, others))}"

    def _reason(self, part: Part) -> str:
        """A smallest set of obstacles without which a goal could be reached."""
        if self.obstacles is None:
            return IN_ANY_CASE
        removed = frozenset(range(len(self.obstacles.reasons)))
        if not removed or not self._reachable(part, removed):
            return IN_ANY_CASE
        for each in reversed(range(len(self.obstacles.reasons))):
            if self._reachable(part, removed - {each}):
                removed -= {each}
        return "; ".join(dict.fromkeys(self.obstacles.reasons[each] for each in sorted(removed)))

    def _reachable(self, part: Part, removed: frozenset[int]) -> bool:
        return not self._infeasible([part], removed, free=True)

    def _infeasible(self, parts: Sequence[Part], removed: Removed = None, free: bool = False) -> bool:
        task = self._task(parts, removed, free)
        return isinstance(plan_task(task, replace(self.limits, improvement=0)), Infeasible)

    def _task(self, parts: Sequence[Part], removed: Removed, free: bool) -> Task:
        """The ground task of some goals, without some obstacles. It is grounded once and asked many times, where that can be.

        If it is `free`, the events of other chains may occur.
        """
        conjuncts = list(goal_parts(self.problem.goal))
        wanted = [conjuncts.index(part.condition) for part in parts if part.condition is not None]
        stages = {part.chain.name: part.stages for part in parts if part.chain is not None}
        others = self._with_events - stages.keys() if free else frozenset()
        if self._separable or not (stages or others):
            task = self._parted(removed).wanting(wanted, stages, others)
            if task is not None:
                return task
        among = self._among(removed)
        asked = self.only(parts, among)
        more = allowed((each for each in among.chains if each.name in others), among.domain)
        return ground(replace(asked, chains=(*asked.chains, *more)))

    def _parted(self, removed: Removed) -> Parted:
        found = self.grounded.pop(removed, None)
        if found is None:
            kept = [part for part in self.parts() if self._separable or part.chain is None]
            found = ground_parts(self.only(kept, self._among(removed)))
        self.grounded[removed] = found
        if len(self.grounded) > KEPT:
            del self.grounded[next(iter(self.grounded))]  # the one that was not asked for longest
        return found

    def _among(self, removed: Removed) -> Problem:
        if removed is None:
            return self.problem
        assert self.obstacles is not None
        return self.obstacles.without(removed)


def _next(whole: Part, final: Part | None) -> Part:
    """The first thing of a goal that is given up: the goal, or its chain up to the first stage that is not kept."""
    return whole if whole.chain is None else whole.cut((final.stages if final else 0) + 1)


def _name(part: Part) -> str:
    if part.chain is None:
        return str(part.condition)
    return f"{part.chain.stages[part.stages - 1]} of {part.chain.name}"
