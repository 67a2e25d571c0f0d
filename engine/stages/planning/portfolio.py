"""Strategy portfolio: the searches of one task, made at first use, and strategies in turns."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.workflow_replay import reach_stages_early
from cellwright.engine.stages.planning.action_elimination import achieved_goal, eliminate_actions
from cellwright.engine.stages.planning.composites import NO_MACROS, Macros
from cellwright.engine.stages.planning.effect_variants import (
    FORWARD_ONLY,
    TooManyVariants,
    plain_steps,
    unconditional_variants,
)
from cellwright.engine.stages.planning.regression.backward_search import (
    BackwardSpace,
    BestFirstRegression,
    HillClimbing,
    Regression,
)
from cellwright.engine.stages.planning.regression.mutex_pairs import find_mutexes
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort, SearchResult

if TYPE_CHECKING:
    from cellwright.engine.stages.planning.forward.forward_search import ForwardSearch

DETOUR_FACTOR = 2  # a plan that costs this many times its relaxed plan may be far from the best
# steps times conditions and effects, up to which stable models are grounded
MAX_GROUNDING_SIZE = 500_000
# how many times the estimate weighs what the cost does, in best-first regression
REGRESSION_GREED = 5
MAX_COMPOSITES = 5_000  # the largest number of MACROP instances in regression


class ResumableSearch(Protocol):
    """A search that can be resumed."""

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
        """


class SearchSetting:
    """A task ready for search.

    What a strategy needs is made when it is first used, and is then kept.
    """

    def __init__(self, task: GroundTask, seed: int = 0, macros: Macros = NO_MACROS) -> None:
        self.task, self.seed, self.macros = task, seed, macros

    @property
    def numeric(self) -> bool:
        """Whether quantities are compared."""
        return self.task.axioms is not None and bool(self.task.axioms.tests)

    @cached_property
    def regression(self) -> Regression | None:
        """The operators for backward chaining; None if there are too many conditional effects
        to split.
        """
        try:
            operators = unconditional_variants(self.task)
        except TooManyVariants:
            return None
        return Regression(operators, self.task.weights, find_mutexes(self.task))

    @cached_property
    def backward(self) -> "BackwardSearches":
        """The backward searches.

        Raises `TooManyVariants`.
        """
        if self.regression is None:
            many = "there are too many conditional effects for backward search"
            raise TooManyVariants(FORWARD_ONLY if self.task.axioms else many)
        return BackwardSearches(self, self.regression)

    @cached_property
    def forward(self) -> "ForwardSearch":
        """The forward search by relaxed plans."""
        from cellwright.engine.stages.planning.forward.forward_search import start_forward_search

        return start_forward_search(self.task, self.seed, patterns=self.macros.forward)

    @cached_property
    def landmarks(self) -> "ForwardSearch":
        """The forward search by relaxed plans and landmarks."""
        from cellwright.engine.stages.planning.forward.forward_search import start_forward_search

        return start_forward_search(
            self.task, self.seed, landmarks=True, patterns=self.macros.forward
        )

    @cached_property
    def restarts(self) -> ResumableSearch:
        """Short forward searches by chance, with and without landmarks in turn."""
        from cellwright.engine.stages.planning.forward.forward_search import RestartingSearch

        return RestartingSearch([lambda: self.forward, lambda: self.landmarks], self.seed)

    @cached_property
    def novelty(self) -> ResumableSearch:
        """The forward search for what is new."""
        from cellwright.engine.stages.planning.forward.novelty_search import NoveltySearch

        return NoveltySearch(self.task, self.seed)

    @cached_property
    def operator_counting(self) -> ResumableSearch | None:
        """The forward search by counts of operators; None if no goal asks for quantities that
        add up.
        """
        from cellwright.engine.stages.planning.forward.operator_counting import search_by_counts

        return search_by_counts(self.task, self.seed)

    @cached_property
    def proof(self) -> ResumableSearch:
        """The proof that no state allows what the goals need."""
        from cellwright.engine.stages.planning.unsolvability import UnsolvabilityProof

        return UnsolvabilityProof(self.task)

    @cached_property
    def models(self) -> ResumableSearch:
        """The search for stable models, with at most `ROOM` grounded conditions and effects.

        Raises `TooManyVariants`.
        """
        return self.parallel(room=MAX_GROUNDING_SIZE)

    def parallel(self, single: bool = False, room: int = 1 << 60) -> ResumableSearch:
        """A search for stable models.

        Raises `TooManyVariants`.
        """
        from cellwright.engine.stages.planning.stable_models import HorizonSearch

        return HorizonSearch(self.task, unconditional_variants(self.task), single, room)


class BackwardSearches:
    """The backward searches of one task."""

    def __init__(self, setting: SearchSetting, regression: Regression) -> None:
        self.space = BackwardSpace(regression, setting.task.initial)
        roots = [root for goal in setting.task.goals if (root := self.space.root(goal)) is not None]
        self.roots = sorted(roots, key=lambda root: self.space.estimate(root.open))
        self._setting, self._seed, self._restarts = setting, setting.seed, 0
        self._climb = HillClimbing(self.space, self.roots[0], self._seed) if self.roots else None

    @cached_property
    def _best_first(self) -> BestFirstRegression:
        """Best-first search from all alternatives of the goals, with the composites that
        MACROPs make.
        """
        patterns = self._setting.macros.backward if self.roots else ()
        return BestFirstRegression(
            self.space.offered(patterns, MAX_COMPOSITES), self.roots, REGRESSION_GREED
        )

    def climb(self, effort: Effort) -> SearchResult | None:
        """Hill climbing towards the nearest alternative of the goals.

        If it finds nothing, this proves that there is no plan only if there is just one
        alternative.
        """
        return self._sure(self._climb.run(effort)) if self._climb else NO_PLAN

    def patient(self, greed: int) -> BestFirstRegression:
        """A best-first search of its own, which looks at cost as much as at what is left."""
        return BestFirstRegression(self.space, self.roots, greed)

    def restart(self, effort: Effort) -> SearchResult | None:
        """Hill climbing from the start again, with ties broken differently, towards the next
        alternative.
        """
        if not self.roots:
            return NO_PLAN
        self._restarts += 1
        root = self.roots[self._restarts % len(self.roots)]
        return self._sure(
            HillClimbing(self.space, root, self._seed * 1_000_003 + self._restarts).run(effort)
        )

    def roundabout(self, answer: SearchResult) -> bool:
        """Whether a plan costs so much more than the goals' relaxed plan that a better one is
        likely.
        """
        steps, charge = answer.steps or (), self.space.regression.relaxation.charge
        return bool(steps) and sum(map(charge, steps)) > DETOUR_FACTOR * self.space.estimate(
            self.roots[0].open
        )

    def _sure(self, answer: SearchResult | None) -> SearchResult | None:
        return None if answer is NO_PLAN and len(self.roots) > 1 else answer

    def best_first(self, effort: Effort) -> SearchResult | None:
        """Best-first search from all alternatives of the goals."""
        return self._best_first.run(effort)


CLIMB_NODES = 2_000  # nodes that hill climbing may generate before other searches start
# nodes that best-first regression may generate before other searches start
QUICK_REGRESSION_NODES = 2_000
SECOND_PLAN_EXPANSIONS = 1000  # expansions that the search for a second plan may take


class TurnLimits(NamedTuple):
    """The limits of a first turn: expansions and generated nodes.

    A turn ends at the limit that is reached first. Each turn is twice as long as the one before.
    Generated nodes are limited, too, because they take the time where expansions have very many
    successors.
    """

    expansions: int
    generated: int = 1 << 60


LANDMARKS_TURN = TurnLimits(8000, 1_000_000)
REGRESSION_TURN = TurnLimits(500, 100_000)
FORWARD_TURN = TurnLimits(1000, 250_000)
MODELS_TURN = TurnLimits(500)
LAYERED, RESTARTED, SHORT = (
    TurnLimits(4000, 500_000),
    TurnLimits(2000, 250_000),
    TurnLimits(500, 60_000),
)
NUMERIC_FIRST_TURN = TurnLimits(500, 25_000)  # landmarks and forward, with quantities
NOVELTY_TURN = TurnLimits(2000, 100_000)
COUNTED = TurnLimits(500, 25_000)
SINGLE_TURN = TurnLimits(1)
# best-first regression, if it takes turns only with restarts
REGRESSION_ALONE_TURN = TurnLimits(4000)
RESTART_TURN = TurnLimits(200)


def search_backward(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """Backward search: first a short hill climbing, then best-first search and new hill climbings
    in turns.

    Best-first search is complete.
    """
    chaining = setting.backward
    return _bound_search(chaining.climb, effort, CLIMB_NODES) or _in_turns(
        [(chaining.best_first, REGRESSION_ALONE_TURN), (chaining.restart, RESTART_TURN)], effort
    )


def search_forward(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """Lazy greedy search from the initial state."""
    return setting.forward.run(effort)


def search_by_landmarks(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """The forward search with additional queues, which are ordered by landmarks."""
    return setting.landmarks.run(effort)


def search_by_novelty(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """The forward search for states with atoms and values that no state as near to the goals
    had.
    """
    return setting.novelty.run(effort)


def count_operators(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """The forward search by how often operators must be done so that quantities add up; in turns
    with `forward`, which can prove that there is no plan."""
    return _in_turns(
        [
            (_run_later(setting, count_only), COUNTED),
            (_run_later(setting, search_forward), NUMERIC_FIRST_TURN),
        ],
        effort,
    )


def count_only(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """The forward search by counts of operators alone; nothing if no goal asks for quantities
    that add up.
    """
    return setting.operator_counting.run(effort) if setting.operator_counting is not None else None


def prove_unsolvable(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """That there is no plan, where derived atoms and quantities rule it out."""
    return setting.proof.run(effort)


def search_stable_models(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with several operators in a step."""
    return setting.parallel().run(effort)


def search_shortest(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with one operator in a step: the first plan has the
    fewest steps.
    """
    return setting.parallel(single=True).run(effort)


def search_automatically(setting: SearchSetting, effort: Effort) -> SearchResult | None:
    """A short backward search first.

    Then landmarks, backward, forward and stable models take turns that double in length. With
    quantities, landmarks, counts of operators, novelty and forward take turns, and where only
    forward searches can plan, landmarks, short searches by chance and forward.
    """
    if setting.regression is None:
        return _in_turns(
            _numeric_turns(setting) if setting.numeric else _forward_turns(setting), effort
        )
    chaining = setting.backward
    quick = _bound_search(chaining.climb, effort, CLIMB_NODES) or _bound_search(
        chaining.best_first, effort, QUICK_REGRESSION_NODES
    )
    if quick:
        return _cheaper_of_two(setting, quick, effort) if chaining.roundabout(quick) else quick
    return _in_turns(
        [
            (_run_later(setting, search_by_landmarks), LANDMARKS_TURN),
            (chaining.best_first, REGRESSION_TURN),
            (_run_later(setting, search_forward), FORWARD_TURN),
            (lambda part: setting.models.run(part), MODELS_TURN),
        ],
        effort,
    )


def _cheaper_of_two(setting: SearchSetting, first: SearchResult, effort: Effort) -> SearchResult:
    """The cheaper one of two plans: the given one, and the one that the search by landmarks finds
    soon.

    Both are compared without needless steps.
    """
    part = effort.part(expansions=SECOND_PLAN_EXPANSIONS)
    second = search_by_landmarks(setting, part)
    effort.add(part)
    if second is None or second.steps is None:
        return first
    return min(first, second, key=lambda answer: _answer_price(setting, answer))


def _answer_price(setting: SearchSetting, answer: SearchResult) -> tuple[int, int]:
    steps = plain_steps(setting.task, answer.steps or ())
    needed = eliminate_actions(
        setting.task.initial,
        reach_stages_early(setting.task, steps),
        achieved_goal(setting.task, steps),
    )
    return sum(step.cost for step in needed), len(needed)


Strategy = Callable[[SearchSetting, Effort], SearchResult | None]
STRATEGIES: dict[str, Strategy] = {
    "auto": search_automatically,
    "backward": search_backward,
    "forward": search_forward,
    "landmarks": search_by_landmarks,
    "novelty": search_by_novelty,
    "counting": count_operators,
    "asp": search_stable_models,
    "shortest": search_shortest,
}


Turns = Sequence[tuple[Callable[[Effort], SearchResult | None], TurnLimits]]


def _forward_turns(setting: SearchSetting) -> Turns:
    """The searches for tasks with derived atoms, and for those with very many conditional
    effects.
    """
    return [
        (_run_later(setting, search_by_landmarks), LAYERED),
        (_run_later(setting, prove_unsolvable), SINGLE_TURN),
        (lambda effort: setting.restarts.run(effort), RESTARTED),
        (_run_later(setting, search_forward), SHORT),
    ]


def _numeric_turns(setting: SearchSetting) -> Turns:
    """The searches for tasks with quantities: landmarks are quick on easy ones."""
    return [
        (_run_later(setting, search_by_landmarks), NUMERIC_FIRST_TURN),
        (_run_later(setting, prove_unsolvable), SINGLE_TURN),
        (_run_later(setting, count_only), COUNTED),
        (_run_later(setting, search_by_novelty), NOVELTY_TURN),
        (_run_later(setting, search_forward), NUMERIC_FIRST_TURN),
    ]


def _run_later(
    setting: SearchSetting, strategy: Strategy
) -> Callable[[Effort], SearchResult | None]:
    return lambda effort: strategy(setting, effort)


def _bound_search(
    run: Callable[[Effort], SearchResult | None], effort: Effort, most: int
) -> SearchResult | None:
    """The answer of a search that may generate at most `most` nodes."""
    part = effort.part(most=most)
    answer = run(part)
    effort.add(part)
    return answer


def _in_turns(turns: Turns, effort: Effort) -> SearchResult | None:
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
