"""Strategies take turns over one task, in slices counted in expansions and in a fixed order, so that plans repeat."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple, Protocol

from engine.model.replay import early
from engine.model.task import Task
from engine.stages.planning.composites import NO_MACROS, Macros
from engine.stages.planning.effort import NO_PLAN, Answer, Effort
from engine.stages.planning.elimination import eliminate, reached
from engine.stages.planning.regression.mutexes import mutexes
from engine.stages.planning.regression.searches import BestFirst, Climb
from engine.stages.planning.regression.space import Backward, Regression
from engine.stages.planning.variants import TooManyVariants, plainly, unconditional

CLIMB = 2_000  # nodes that hill climbing may generate before others have a turn
QUICK = 2_000  # nodes that best-first regression may generate before searches forward have a turn
DETOUR = 2  # a plan so many times as costly as a relaxed one may be far from the best
SECOND = 1000  # expansions that may be spent on another
ROOM = 1_500_000  # conditions and effects by steps that the portfolio grounds for stable models
GREED = 5
COMPOSITES = 5_000  # instances of MACROPs that are made for regression


class Turn(NamedTuple):
    """The expansions and the generated nodes of a first turn, whichever come first; every turn is twice as long as the one
    before. Where expansions have very many successors, these are what takes the time."""

    expansions: int
    generated: int = 1 << 60


LANDMARKS = Turn(8000, 1_000_000)
REGRESSION = Turn(500, 100_000)
FORWARD = Turn(1000, 250_000)
MODELS = Turn(500)
ALONE = Turn(4000)  # best-first regression, where only restarts are beside it
RESTART = Turn(200)


class Search(Protocol):
    """A search that can be resumed."""

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""


class Setting:
    """A task ready for search; what a strategy needs is made when it is first asked for, and kept."""

    def __init__(self, task: Task, seed: int = 0, macros: Macros = NO_MACROS) -> None:
        self.task, self.seed, self.macros = task, seed, macros

    @cached_property
    def regression(self) -> Regression | None:
        """The operators for backward chaining, None if there are too many effects to split."""
        try:
            operators = unconditional(self.task)
        except TooManyVariants:
            return None
        return Regression(operators, self.task.weights, mutexes(self.task))

    @cached_property
    def backward(self) -> "Chaining":
        """The searches backward. Raises `TooManyVariants`."""
        if self.regression is None:
            raise TooManyVariants("too many conditional effects to chain backward over")
        return Chaining(self, self.regression)

    @cached_property
    def forward(self) -> Search:
        """The search forward by relaxed plans."""
        from engine.stages.planning.forward.search import (
            forward,  # compiled kernels are loaded only when they are needed
        )

        return forward(self.task, self.seed, patterns=self.macros.forward)

    @cached_property
    def landmarks(self) -> Search:
        """The search forward by relaxed plans and landmarks."""
        from engine.stages.planning.forward.search import forward

        return forward(self.task, self.seed, landmarks=True, patterns=self.macros.forward)

    @cached_property
    def models(self) -> Search:
        """The search for stable models, within bounds. Raises `TooManyVariants`."""
        return self.parallel(room=ROOM)

    def parallel(self, single: bool = False, room: int = 1 << 60) -> Search:
        """A search for stable models. Raises `TooManyVariants`."""
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
        """From all alternatives, with the composites that MACROPs make."""
        patterns = self._setting.macros.backward if self.roots else ()
        return BestFirst(self.space.offered(patterns, COMPOSITES), self.roots, GREED)

    def climb(self, effort: Effort) -> Answer | None:
        """Hill climbing towards the nearest alternative of the goals; only if there is one alone is its end a proof."""
        return self._sure(self._climb.run(effort)) if self._climb else NO_PLAN

    def restart(self, effort: Effort) -> Answer | None:
        """Hill climbing anew, with other ties, towards the next alternative."""
        if not self.roots:
            return NO_PLAN
        self._restarts += 1
        root = self.roots[self._restarts % len(self.roots)]
        return self._sure(Climb(self.space, root, self._seed * 1_000_003 + self._restarts).run(effort))

    def roundabout(self, answer: Answer) -> bool:
        """Whether a plan costs so much more than the goals' relaxed plan that others are worth a look."""
        steps, charge = answer.steps or (), self.space.regression.relaxation.charge
        return bool(steps) and sum(map(charge, steps)) > DETOUR * self.space.estimate(self.roots[0].open)

    def _sure(self, answer: Answer | None) -> Answer | None:
        return None if answer is NO_PLAN and len(self.roots) > 1 else answer

    def best_first(self, effort: Effort) -> Answer | None:
        """From all alternatives."""
        return self._best_first.run(effort)


def backward(setting: Setting, effort: Effort) -> Answer | None:
    """Hill climbing while it is quick, then best first, which is complete, with restarts of the climb in between."""
    chaining = setting.backward
    return _bounded(chaining.climb, effort, CLIMB) or _in_turns(
        [(chaining.best_first, ALONE), (chaining.restart, RESTART)], effort
    )


def forward(setting: Setting, effort: Effort) -> Answer | None:
    """Lazy greedy search from the initial state."""
    return setting.forward.run(effort)


def landmarks(setting: Setting, effort: Effort) -> Answer | None:
    """The same with queues ordered by landmarks beside those ordered by relaxed plans."""
    return setting.landmarks.run(effort)


def asp(setting: Setting, effort: Effort) -> Answer | None:
    """Stable models by horizon, several operators a step."""
    return setting.parallel().run(effort)


def shortest(setting: Setting, effort: Effort) -> Answer | None:
    """Stable models by horizon, one operator a step: the first plan has the fewest steps."""
    return setting.parallel(single=True).run(effort)


def auto(setting: Setting, effort: Effort) -> Answer | None:
    """Regression while it is quick; then by landmarks, backward, forward and stable models in turns that double."""
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


def _second(setting: Setting, first: Answer, effort: Effort) -> Answer:
    """The cheaper one of a plan and what the search by landmarks finds soon, both without needless steps."""
    part = effort.part(expansions=SECOND)
    other = landmarks(setting, part)
    effort.add(part)
    if other is None or other.steps is None:
        return first
    return min(first, other, key=lambda each: _price(setting, each))


def _price(setting: Setting, answer: Answer) -> tuple[int, int]:
    steps = plainly(setting.task, answer.steps or ())
    kept = eliminate(setting.task.initial, early(setting.task, steps), reached(setting.task, steps))
    return sum(step.cost for step in kept), len(kept)


Strategy = Callable[[Setting, Effort], Answer | None]
STRATEGIES: dict[str, Strategy] = {
    "auto": auto,
    "backward": backward,
    "forward": forward,
    "landmarks": landmarks,
    "asp": asp,
    "shortest": shortest,
}


def _later(setting: Setting, strategy: Strategy) -> Callable[[Effort], Answer | None]:
    return lambda effort: strategy(setting, effort)


def _bounded(run: Callable[[Effort], Answer | None], effort: Effort, most: int) -> Answer | None:
    """A search as long as it has generated no more than `most` nodes."""
    part = effort.part(most=most)
    answer = run(part)
    effort.add(part)
    return answer


def _in_turns(
    turns: Sequence[tuple[Callable[[Effort], Answer | None], Turn]], effort: Effort
) -> Answer | None:
    """Run searches in turn, given with their first turns, until one answers or the effort is spent."""
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
