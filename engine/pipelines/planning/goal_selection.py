"""Selects the goals that can be reached together; gives up the others, each with a reason.

Goals are conjuncts of the goal, one for each object where it is about all, and chains. A chain of
which some stage cannot be reached is given up as a whole: a probe is not heated if it can no longer
be cooled. Only the stages that another goal needs are kept of it. A chain that waits for another
one no longer waits if that one is given up. An event occurs only as a stage of a chain. So what can
be reached by itself is asked with the events of all chains allowed, and what needs an event of a
chain is tried again once that chain is kept.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, Infeasible, Outcome
from cellwright.engine.model.part_measurements import names_in_goal
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.quantifiers import expand_forall
from cellwright.engine.stages.grounding import ground, ground_parts, has_separable_chains
from cellwright.engine.stages.grounding.ground_goals import TaskWithoutGoals
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Condition,
    Literal,
    goal_parts,
    literals_in,
)
from cellwright.kb.model.planning_problem import Chain, Problem, event_chains, events_of

NOTHING_MORE = "no goal that is still open can be reached"
IN_ANY_CASE = "it cannot be reached from this state, whatever is done"
NOT_BEGUN = "not begun: what comes after it cannot be reached"
NO_EVENT = "it needs an event of a workflow that is given up"
MAX_KEPT_TASKS = 16  # ground tasks

Planner = Callable[[Problem, SearchLimits], Outcome]
# obstacles without which a problem is looked at; None: as it was given
Removed = frozenset[int] | None


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What may keep goals from being reached: what each of them is, and the problem as it would
    be without some of them.
    """

    reasons: tuple[str, ...]
    without: Callable[[frozenset[int]], Problem]


@dataclass(frozen=True, slots=True)
class RelinquishedGoal:
    """A goal that is not planned for, and why."""

    goal: str
    why: str


@dataclass(frozen=True, slots=True)
class GoalSelection:
    """The problem with the goals that can be reached, the answer for it, and the goals that are
    given up.
    """

    problem: Problem
    outcome: Outcome
    given_up: tuple[RelinquishedGoal, ...] = ()


@dataclass(frozen=True, slots=True)
class GoalPart:
    """A conjunct of the goal, or a chain up to one of its stages."""

    condition: Condition | None = None
    chain: Chain | None = None
    stages: int = 0

    def cut(self, stages: int) -> "GoalPart":
        """The chain up to fewer stages."""
        return replace(self, stages=stages)


def select_goals(
    problem: Problem,
    obstacles: Obstacles | None = None,
    limits: SearchLimits = SearchLimits(),
    outcome: Outcome | None = None,
    planner: Planner = checked_plan.plan_problem,
) -> GoalSelection:
    """A plan for as many goals as can be reached, in the order in which they are named. Raises
    `InvalidInput`.

    `outcome` is the answer for all goals, if it is known already. `planner` answers whole problems.

    No plan exists if no goal that is still open can be reached. A search that gives up proves
    nothing: its answer is passed on, and no goal is given up for it.
    """
    outcome = outcome or planner(problem, limits)
    if not isinstance(outcome, Infeasible):
        return GoalSelection(problem, outcome)
    problem = expand_forall(problem)
    search = _Search(problem, obstacles, limits)
    asked_parts = search.parts()
    alone = [search.alone(part) for part in asked_parts]
    kept_parts = search.together(
        [part for part, longest in zip(asked_parts, alone, strict=True) if longest == part]
    )
    kept_parts = search.supported(kept_parts, [part for part in alone if part is not None])
    given_up = tuple(search.given_up(asked_parts, alone, kept_parts))
    remaining = search.only(kept_parts)
    answer = planner(remaining, limits) if kept_parts else outcome
    if not kept_parts or (isinstance(answer, Found) and not answer.plan.steps):
        return GoalSelection(problem, replace(outcome, reason=NOTHING_MORE), given_up)
    return GoalSelection(remaining, answer, given_up)


@dataclass(frozen=True)
class _Search:
    problem: Problem
    obstacles: Obstacles | None
    limits: SearchLimits
    grounded: dict[Removed, TaskWithoutGoals] = field(default_factory=dict)

    @cached_property
    def _separable(self) -> bool:
        return has_separable_chains(self.problem)

    @cached_property
    def _with_events(self) -> frozenset[str]:
        """The chains of which some stage is an event."""
        domain = self.problem.domain
        return frozenset(chain.name for chain in self.problem.chains if events_of(chain, domain))

    def parts(self) -> list[GoalPart]:
        """All goals, whole."""
        conjuncts = [GoalPart(condition=conjunct) for conjunct in goal_parts(self.problem.goal)]
        return conjuncts + [
            GoalPart(chain=chain, stages=len(chain.stages)) for chain in self.problem.chains
        ]

    def only(self, parts: Iterable[GoalPart], among: Problem | None = None) -> Problem:
        """The problem with some of its goals alone."""
        problem = among or self.problem
        lengths = {part.chain.name: part.stages for part in parts if part.chain is not None}
        whole = {c.name for c in problem.chains if lengths.get(c.name) == len(c.stages)}
        chains = tuple(
            replace(chain, stages=chain.stages[: lengths[chain.name]]).wait_only_for(whole)
            for chain in problem.chains
            if chain.name in lengths
        )
        goal = And(tuple(part.condition for part in parts if part.condition is not None))
        return replace(problem, goal=goal, chains=chains)

    def alone(self, part: GoalPart) -> GoalPart | None:
        """As much of a goal as can be reached if nothing else is wanted, and all events may
        occur; None if that is nothing.
        """
        return self._longest([], part, free=True)

    def together(self, parts: list[GoalPart]) -> list[GoalPart]:
        """Goals that can be reached together: all of them, else one after the other is added if
        it can be.
        """
        if not parts or not self._infeasible(parts):
            return parts
        kept_by_number: dict[int, GoalPart] = {}
        while True:
            before = dict(kept_by_number)
            for number, part in enumerate(parts):
                if number not in kept_by_number and not self._infeasible(
                    [*kept_by_number.values(), part]
                ):
                    kept_by_number[number] = part
            # a goal may need an event of a later chain
            if kept_by_number == before or not self._with_events:
                return [kept_by_number[number] for number in sorted(kept_by_number)]

    def supported(self, kept: list[GoalPart], alone: Sequence[GoalPart]) -> list[GoalPart]:
        """What is kept, with the goals that need only some stages of a chain whose end is out
        of reach, and these stages.
        """
        for goal in [part for part in alone if part.chain is None and part not in kept]:
            names = {part.chain.name for part in kept if part.chain is not None}
            cuts = [
                part.cut(n)
                for part in alone
                if part.chain is not None
                for n in range(1, part.stages + 1)
            ]
            fit = (
                [*kept, cut, goal]
                for cut in cuts
                if cut.chain is not None and cut.chain.name not in names
            )
            kept = next((parts for parts in fit if not self._infeasible(parts)), kept)
        return kept

    def given_up(
        self,
        asked_goals: Sequence[GoalPart],
        alone: Sequence[GoalPart | None],
        kept_goals: Sequence[GoalPart],
    ) -> Iterator[RelinquishedGoal]:
        """What is not kept of each goal, with the reason."""
        for whole, reachable in zip(asked_goals, alone, strict=True):
            if whole in kept_goals:
                continue
            rivalled = reachable == whole
            first = _first_given_up(
                whole, self._longest(kept_goals, whole) if rivalled else reachable
            )
            begun = next(
                (
                    part.stages
                    for part in kept_goals
                    if part.chain is not None and part.chain is whole.chain
                ),
                0,
            )
            for stage in (
                whole.chain.stages[begun : first.stages - 1] if whole.chain is not None else ()
            ):
                yield RelinquishedGoal(f"{stage} of {_chain_name(whole)}", NOT_BEGUN)
            yield RelinquishedGoal(
                _goal_name(first),
                self._rivals(kept_goals, whole, first) if rivalled else self._reason(first),
            )
            if whole.chain is not None:
                last = whole.chain.stages[first.stages - 1]
                for stage in whole.chain.stages[first.stages :]:
                    yield RelinquishedGoal(
                        f"{stage} of {whole.chain.name}", f"it comes after {last}"
                    )

    def _longest(
        self, other_goals: Sequence[GoalPart], part: GoalPart, free: bool = False
    ) -> GoalPart | None:
        if part.chain is None:
            return None if self._infeasible([*other_goals, part], free=free) else part
        cuts = (part.cut(stages) for stages in range(part.stages, 0, -1))
        return next(
            (cut for cut in cuts if not self._infeasible([*other_goals, cut], free=free)), None
        )

    def _rivals(self, kept_goals: Sequence[GoalPart], whole: GoalPart, first: GoalPart) -> str:
        """Why a goal that can be reached by itself is not among those that are kept."""
        moved = any(
            kept_part.chain is not None and kept_part.chain.name in self._with_events
            for kept_part in kept_goals
        )
        if not moved and self._infeasible([first]):
            return NO_EVENT
        rivals = (
            kept_part
            for kept_part in kept_goals
            if kept_part.chain is not whole.chain or whole.chain is None
        )
        return f"it cannot be reached together with {', '.join(map(_goal_name, rivals))}"

    def _reason(self, part: GoalPart) -> str:
        """A smallest set of obstacles without which a goal could be reached."""
        if self.obstacles is None:
            return IN_ANY_CASE
        removed = frozenset(range(len(self.obstacles.reasons)))
        if not removed or not self._reachable(part, removed):
            return IN_ANY_CASE
        for obstacle in reversed(range(len(self.obstacles.reasons))):
            if self._reachable(part, removed - {obstacle}):
                removed -= {obstacle}
        return "; ".join(
            dict.fromkeys(self.obstacles.reasons[obstacle] for obstacle in sorted(removed))
        )

    def _reachable(self, part: GoalPart, removed: frozenset[int]) -> bool:
        return not self._infeasible([part], removed, free=True)

    def _infeasible(
        self, parts: Sequence[GoalPart], removed: Removed = None, free: bool = False
    ) -> bool:
        task = self._task(parts, removed, free)
        return isinstance(plan_task(task, replace(self.limits, improvement=0)), Infeasible)

    def _task(self, parts: Sequence[GoalPart], removed: Removed, free: bool) -> GroundTask:
        """The ground task of some goals, without some obstacles. It is grounded once and asked many
        times, where that can be.

        If it is `free`, the events of other chains may occur.
        """
        conjuncts = list(goal_parts(self.problem.goal))
        conjunct_numbers = [
            conjuncts.index(part.condition) for part in parts if part.condition is not None
        ]
        stages = {part.chain.name: part.stages for part in parts if part.chain is not None}
        free_chains = self._with_events - stages.keys() if free else frozenset()
        if self._separable or not (stages or free_chains):
            task = self._parted(removed).wanting(conjunct_numbers, stages, free_chains)
            if task is not None:
                return task
        among = self._among(removed)
        asked = self.only(parts, among)
        more = event_chains(
            (chain for chain in among.chains if chain.name in free_chains), among.domain
        )
        return ground(replace(asked, chains=(*asked.chains, *more)))

    def _parted(self, removed: Removed) -> TaskWithoutGoals:
        parted = self.grounded.pop(removed, None)
        if parted is None:
            kept_parts = [part for part in self.parts() if self._separable or part.chain is None]
            parted = ground_parts(self.only(kept_parts, self._among(removed)))
        self.grounded[removed] = parted
        if len(self.grounded) > MAX_KEPT_TASKS:
            del self.grounded[next(iter(self.grounded))]  # the one that was not asked for longest
        return parted

    def _among(self, removed: Removed) -> Problem:
        if removed is None:
            return self.problem
        assert self.obstacles is not None
        return self.obstacles.without(removed)


def _first_given_up(whole: GoalPart, final: GoalPart | None) -> GoalPart:
    """The first thing of a goal that is given up: the goal, or its chain up to the first stage
    that is not kept.
    """
    return whole if whole.chain is None else whole.cut((final.stages if final else 0) + 1)


def _chain_name(part: GoalPart) -> str:
    return part.chain.name if part.chain is not None else ""


def _goal_name(part: GoalPart) -> str:
    if part.chain is None:
        return str(part.condition)
    return f"{part.chain.stages[part.stages - 1]} of {part.chain.name}"


def drop_unreachable_goals(
    problem: Problem, lost: Mapping[str, str]
) -> tuple[Problem, tuple[RelinquishedGoal, ...]]:
    """The problem without its goals about lost measurements, of which is said why, and those goals.

    A workflow ends before the first stage about one of them; none waits for one that is cut. Where
    nothing would be left, the problem stays as it is.
    """
    if not lost:
        return problem, ()
    kept_conditions, chains, given_up = _split_goals(problem, lost)
    if not kept_conditions and not chains:
        return problem, ()
    return replace(
        problem, goal=And(kept_conditions) if kept_conditions else ALWAYS_TRUE, chains=chains
    ), given_up


def all_lost(problem: Problem, lost: Mapping[str, str]) -> tuple[RelinquishedGoal, ...]:
    """The goals about lost measurements of a problem for which there is no plan, each with its
    reason.
    """
    return _split_goals(problem, lost)[2]


def _split_goals(
    problem: Problem, lost: Mapping[str, str]
) -> tuple[tuple[Condition, ...], tuple[Chain, ...], tuple[RelinquishedGoal, ...]]:
    """The parts of the goal and the chains that are kept, and what is given up."""
    parts = goal_parts(problem.goal)
    kept_conditions = tuple(part for part in parts if not _is_about_lost(part, lost))
    given_up = [
        RelinquishedGoal(str(part), _loss_reason(part, lost))
        for part in parts
        if _is_about_lost(part, lost)
    ]
    chains = list[Chain]()
    for chain in problem.chains:
        cuts = (n for n, stage in enumerate(chain.stages) if _is_about_lost(Literal(stage), lost))
        cut = next(cuts, len(chain.stages))
        given_up += _given_up_stages(chain, cut, lost)
        chains += [replace(chain, stages=chain.stages[:cut])] if cut else []
    whole = {chain.name for chain in chains if chain in problem.chains}
    chains = [chain.wait_only_for(whole) for chain in chains]
    return kept_conditions, tuple(chains), tuple(given_up)


def _is_about_lost(goal: Condition, lost: Mapping[str, str]) -> bool:
    """Whether a goal asks for nothing but facts about lost measurements."""
    asked = list(literals_in(goal))
    return bool(asked) and all(
        literal.positive and names_in_goal(literal, lost) for literal in asked
    )


def _loss_reason(goal: Condition, lost: Mapping[str, str]) -> str:
    return "; ".join(lost[name] for name in sorted(names_in_goal(goal, lost)))


def _given_up_stages(chain: Chain, cut: int, lost: Mapping[str, str]) -> Iterator[RelinquishedGoal]:
    """The stages of a chain from the first one on that cannot be reached."""
    for n, stage in enumerate(chain.stages[cut:]):
        why = f"it comes after {chain.stages[cut]}" if n else _loss_reason(Literal(stage), lost)
        yield RelinquishedGoal(f"{stage} of {chain.name}", why)
