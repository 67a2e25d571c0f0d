"""Strategies that take turns on one task.

The turns are counted in expansions and have a fixed order, so that the same input gives the same plan.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple, Protocol

from engine.model.replay import early
from engine.model.task import Task
from engine.stages.planning.composites import NO_MACROS, Macros
from engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from engine.stages.planning.elimination import eliminate, reached
from engine.stages.planning.regression.mutexes import mutexes
from engine.stages.planning.regression.searches import BestFirst, Climb
from engine.stages.planning.regression.space import Backward, Regression
from engine.stages.planning.variants import FORWARD_ONLY, TooManyVariants, plainly, unconditional

CLIMB = 2_000  # nodes that hill climbing may generate before other searches start
QUICK = 2_000  # nodes that best-first regression may generate before other searches start
DETOUR = 2  # a plan that costs this many times its relaxed plan may be far from the best
SECOND = 1000  # expansions that the search for a second plan may take
ROOM = 1_500_000  # steps times conditions and effects, up to which stable models are grounded
GREED = 5
COMPOSITES = 5_000  # the largest number of MACROP instances in regression


class Turn(NamedTuple):
    """The limits of a first turn: expansions and generated nodes.

    A turn ends at the limit that is reached first. Each turn is twice as long as the one before. Generated
    nodes are limited, too, because they take the time where expansions have very many successors.
    """

    expansions: int
    generated: int = 1 << 60


LANDMARKS = Turn(8000, 1_000_000)
REGRESSION = Turn(500, 100_000)
FORWARD = Turn(1000, 250_000)
MODELS = Turn(500)
ALONE = Turn(4000)  # best-first regression, if it takes turns only with restarts
RESTART = Turn(200)


class Search(Protocol):
    """A search that can be resumed."""

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is spent.
        """


class Setting:
    """A task ready for search. What a strategy needs is made when it is first used, and is then kept."""

    def __init__(self, task: Task, seed: int = 0, macros: Macros = NO_MACROS) -> None:
        self.task, self.seed, self.macros = task, seed, macros

    @cached_property
    def regression(self) -> Regression | None:
        """The operators for backward chaining; None if there are too many conditional effects to split."""
        try:
            operators = unconditional(self.task)
        except TooManyVariants:
            return None
        return Regression(operators, self.task.weights, mutexes(self.task))

    @cached_property
    def backward(self) -> "Chaining":
        """The backward searches.

        Raises `TooManyVariants`.
        """
        if self.regression is None:
            many = "there are too many conditional effects for backward search"
            raise TooManyVariants(FORWARD_ONLY if self.task.axioms else many)
        return Chaining(self, self.regression)

    @cached_property
    def forward(self) -> Search:
        """The forward search by relaxed plans."""
        from engine.stages.planning.forward.search import (
            forward,  # imported here, so that compiled kernels are loaded only if needed
        )

        return forward(self.task, self.seed, patterns=self.macros.forward)

    @cached_property
    def landmarks(self) -> Search:
        """The forward search by relaxed plans and landmarks."""
        from engine.stages.planning.forward.search import forward

        return forward(self.task, self.seed, landmarks=True, patterns=self.macros.forward)

    @cached_property
    def models(self) -> Search:
        """The search for stable models, with at most `ROOM` grounded conditions and effects.

        Raises `TooManyVariants`.
        """
        return self.parallel(room=ROOM)

    def parallel(self, single: bool = False, room: int = 1 << 60) -> Search:
        """A search for stable models.

        Raises `TooManyVariants`.
        """
        from engine.stages.planning.stable_models.horizons import Parallel

        return Parallel(self.task, unconditional(self.task), single, room)


class Chaining:
    """The backward searches of one task."""

    def __init__(self, setting: Setting, regression: Regression) -> None:
        self.space = Backward(regression, setting.task.initial)
        roots = [root for goal in setting.task.goals if (root := self.space.root(goal)) is not None]
        self.roots = sorted(roots, key=lambda root: self.space.estimate(root.open))
        self._setting, self._seed, self._restarts = setting, setting.seed, 0
        self._climb = Climb(self.space, self.roots[0], self._seed) if self.roots else None

    @cached_property
    def _best_first(self) -> BestFirst:
        """Best-first search from all alternatives of the goals, with the composites that MACROPs make."""
        patterns = self._setting.macros.backward if self.roots else ()
        return BestFirst(self.space.offered(patterns, COMPOSITES), self.roots, GREED)

    def climb(self, effort: Effort) -> SearchResult | None:
        """Hill climbing towards the nearest alternative of the goals.

        If it finds nothing, this proves that there is no plan only if there is just one alternative.
        """
        return self._sure(self._climb.run(effort)) if self._climb else NO_PLAN

    def patient(self, greed: int) -> BestFirst:
        """A best-first search of its own, which looks at cost as much as at what is left."""
        return BestFirst(self.space, self.roots, greed)

    def restart(self, effort: Effort) -> SearchResult | None:
        """Hill climbing from the start again, with ties broken differently, towards the next alternative."""
        if not self.roots:
            return NO_PLAN
        self._restarts += 1
        root = self.roots[self._restarts % len(self.roots)]
        return self._sure(Climb(self.space, root, self._seed * 1_000_003 + self._restarts).run(effort))

    def roundabout(self, answer: SearchResult) -> bool:
        """Whether a plan costs so much more than the goals' relaxed plan that a better one is likely."""
        steps, charge = answer.steps or (), self.space.regression.relaxation.charge
        return bool(steps) and sum(map(charge, steps)) > DETOUR * self.space.estimate(self.roots[0].open)

    def _sure(self, answer: SearchResult | None) -> SearchResult | None:
        return None if answer is NO_PLAN and len(self.roots) > 1 else answer

    def best_first(self, effort: Effort) -> SearchResult | None:
        """Best-first search from all alternatives of the goals."""
        return self._best_first.run(effort)


def backward(setting: Setting, effort: Effort) -> SearchResult | None:
    """Backward search: first a short hill climbing, then best-first search and new hill climbings in turns.

    Best-first search is complete.
    """
    chaining = setting.backward
    return _bounded(chaining.climb, effort, CLIMB) or _in_turns(
        [(chaining.best_first, ALONE), (chaining.restart, RESTART)], effort
    )


def forward(setting: Setting, effort: Effort) -> SearchResult | None:
    """Lazy greedy search from the initial state."""
    return setting.forward.run(effort)


def landmarks(setting: Setting, effort: Effort) -> SearchResult | None:
    """The forward search with additional queues, which are ordered by landmarks."""
    return setting.landmarks.run(effort)


def asp(setting: Setting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with several operators in a step."""
    return setting.parallel().run(effort)


def shortest(setting: Setting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with one operator in a step: the first plan has the fewest steps."""
    return setting.parallel(single=True).run(effort)


def auto(setting: Setting, effort: Effort) -> SearchResult | None:
    """A short backward search first.

    Then landmarks, backward, forward and stable models take turns that double in length.
    """
    if setting.regression is None:
        return _in_turns(
            [(_later(setting, landmarks), LANDMARKS), (_later(setting, forward), FORWARD)], effort
        )
    chaining = setting.backward
    quick = _bounded(chaining.climb, effort, CLIMB) or _bounded(chaining.best_first, effort, QUICK)
    if quick:
        return _second(setting, quick, effort) if chaining.roundabout(quick) else quick
    return _in_turns(
        [
            (_later(setting, landmarks), LANDMARKS),
            (chaining.best_first, REGRESSION),
            (_later(setting, forward), FORWARD),
            (lambda part: setting.models.run(part), MODELS),
        ],
        effort,
    )


def _second(setting: Setting, first: SearchResult, effort: Effort) -> SearchResult:
    """The cheaper one of two plans: the given one, and the one that the search by landmarks finds soon.

    Both are compared without needless steps.
    """
    part = effort.part(expansions=SECOND)
    other = landmarks(setting, part)
    effort.add(part)
    if other is None or other.steps is None:
        return first
    return min(first, other, key=lambda each: _price(setting, each))


def _price(setting: Setting, answer: SearchResult) -> tuple[int, int]:
    steps = plainly(setting.task, answer.steps or ())
    kept = eliminate(setting.task.initial, early(setting.task, steps), reached(setting.task, steps))
    return sum(step.cost for step in kept), len(kept)


Strategy = Callable[[Setting, Effort], SearchResult | None]
STRATEGIES: dict[str, Strategy] = {
    "auto": auto,
    "backward": backward,
    "forward": forward,
    "landmarks": landmarks,
    "asp": asp,
    "shortest": shortest,
}


def _later(setting: Setting, strategy: Strategy) -> Callable[[Effort], SearchResult | None]:
    return lambda effort: strategy(setting, effort)


def _bounded(run: Callable[[Effort], SearchResult | None], effort: Effort, most: int) -> SearchResult | None:
    """The answer of a search that may generate at most `most` nodes."""
    part = effort.part(most=most)
    answer = run(part)
    effort.add(part)
    return answer


def _in_turns(
    turns: Sequence[tuple[Callable[[Effort], SearchResult | None], Turn]], effort: Effort
) -> SearchResult | None:
    """Runs searches in turn until one answers or the effort is spent.

    Each search is given with its first turn.
    """
    factor = 1
    while not effort.spent():
        for run, first in turns:
            part = effort.part(factor * first.expansions, factor * first.generated)
            answer = run(part)
            effort.add(part)
            if answer is not None:
                return answer
        factor *= 2
    return None
