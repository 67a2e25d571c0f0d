"""Strategies that take turns on one task.

The turns are counted in expansions and have a fixed order, so that the same input gives the same plan.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from cellwright.engine.model.replay import early
from cellwright.engine.stages.planning.effort import Effort, SearchResult
from cellwright.engine.stages.planning.elimination import eliminate, reached
from cellwright.engine.stages.planning.setting import Setting
from cellwright.engine.stages.planning.variants import plainly

CLIMB = 2_000  # nodes that hill climbing may generate before other searches start
QUICK = 2_000  # nodes that best-first regression may generate before other searches start
SECOND = 1000  # expansions that the search for a second plan may take


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
LAYERED, RESTARTED, SHORT = Turn(4000, 500_000), Turn(2000, 250_000), Turn(500, 60_000)
BEGINNING = Turn(500, 25_000)  # landmarks and forward, with quantities
NOVELTY = Turn(2000, 100_000)
ONCE = Turn(1)
ALONE = Turn(4000)  # best-first regression, if it takes turns only with restarts
RESTART = Turn(200)


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


def novelty(setting: Setting, effort: Effort) -> SearchResult | None:
    """The forward search for states with atoms and values that no state as near to the goals had."""
    return setting.novelty.run(effort)


def proof(setting: Setting, effort: Effort) -> SearchResult | None:
    """That there is no plan, where derived atoms and quantities rule it out."""
    return setting.proof.run(effort)


def asp(setting: Setting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with several operators in a step."""
    return setting.parallel().run(effort)


def shortest(setting: Setting, effort: Effort) -> SearchResult | None:
    """Stable models, horizon by horizon, with one operator in a step: the first plan has the fewest steps."""
    return setting.parallel(single=True).run(effort)


def auto(setting: Setting, effort: Effort) -> SearchResult | None:
    """A short backward search first.

    Then landmarks, backward, forward and stable models take turns that double in length. With quantities, landmarks, novelty
    and forward take turns, and where only forward searches can plan, landmarks, short searches by chance and forward.
    """
    if setting.regression is None:
        return _in_turns(_numeric(setting) if setting.numeric else _forwards(setting), effort)
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
    "novelty": novelty,
    "asp": asp,
    "shortest": shortest,
}


Turns = Sequence[tuple[Callable[[Effort], SearchResult | None], Turn]]


def _forwards(setting: Setting) -> Turns:
    """The searches for tasks with derived atoms, and for those with very many conditional effects."""
    return [
        (_later(setting, landmarks), LAYERED),
        (_later(setting, proof), ONCE),
        (lambda effort: setting.restarts.run(effort), RESTARTED),
        (_later(setting, forward), SHORT),
    ]


def _numeric(setting: Setting) -> Turns:
    """The searches for tasks with quantities: landmarks are quick on easy ones."""
    return [
        (_later(setting, landmarks), BEGINNING),
        (_later(setting, proof), ONCE),
        (_later(setting, novelty), NOVELTY),
        (_later(setting, forward), BEGINNING),
    ]


def _later(setting: Setting, strategy: Strategy) -> Callable[[Effort], SearchResult | None]:
    return lambda effort: strategy(setting, effort)


def _bounded(run: Callable[[Effort], SearchResult | None], effort: Effort, most: int) -> SearchResult | None:
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
