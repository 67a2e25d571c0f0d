"""A task ready for search: the searches that strategies run, each made when it is first used."""

from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from cellwright.engine.model.task import Task
from cellwright.engine.stages.planning.composites import NO_MACROS, Macros
from cellwright.engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from cellwright.engine.stages.planning.regression.mutexes import mutexes
from cellwright.engine.stages.planning.regression.searches import BestFirst, Climb
from cellwright.engine.stages.planning.regression.space import Backward, Regression
from cellwright.engine.stages.planning.variants import FORWARD_ONLY, TooManyVariants, unconditional

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.search import Forward

DETOUR = 2  # a plan that costs this many times its relaxed plan may be far from the best
ROOM = 500_000  # steps times conditions and effects, up to which stable models are grounded
GREED = 5  # how many times the estimate weighs what the cost does, in best-first regression
COMPOSITES = 5_000  # the largest number of MACROP instances in regression


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

    @property
    def numeric(self) -> bool:
        """Whether quantities are compared."""
        return self.task.axioms is not None and bool(self.task.axioms.tests)

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
    def forward(self) -> "Forward":
        """The forward search by relaxed plans."""
        from cellwright.engine.stages.planning.forward.search import (
            forward,  # imported here, so that compiled kernels are loaded only if needed
        )

        return forward(self.task, self.seed, patterns=self.macros.forward)

    @cached_property
    def landmarks(self) -> "Forward":
        """The forward search by relaxed plans and landmarks."""
        from cellwright.engine.stages.planning.forward.search import forward

        return forward(self.task, self.seed, landmarks=True, patterns=self.macros.forward)

    @cached_property
    def restarts(self) -> Search:
        """Short forward searches by chance, with and without landmarks in turn."""
        from cellwright.engine.stages.planning.forward.restarts import Restarts

        return Restarts([lambda: self.forward, lambda: self.landmarks], self.seed)

    @cached_property
    def novelty(self) -> Search:
        """The forward search for what is new."""
        from cellwright.engine.stages.planning.forward.newest import Newest

        return Newest(self.task, self.seed)

    @cached_property
    def proof(self) -> Search:
        """The proof that no state allows what the goals need."""
        from cellwright.engine.stages.planning.consistency import Proof

        return Proof(self.task)

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
        from cellwright.engine.stages.planning.stable_models.horizons import Parallel

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
