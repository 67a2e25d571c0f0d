"""Strategies take turns over one task, in slices counted in expansions and in a fixed order, so that plans repeat."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from engine.model.task import Bits, GroundOperator, Task
from engine.planning.backward import Answer, Backward, Effort, space
from engine.planning.regression import BestFirst, Climb
from kb.terms import Function

CLIMB = 2_000  # nodes that hill climbing may generate before others have a turn
QUICK = 20_000  # nodes that best-first regression may generate before compiled kernels are loaded
FORWARD = 4000  # of the first turn forward; every turn is twice as long as the one before
REGRESSION = 500
LANDMARKS = 1000
GREED = 5


class Search(Protocol):
    """A search that can be resumed."""

    def run(self, effort: Effort) -> Answer | None:
        """Search on until the effort is spent: a plan, the proof that there is none, or None."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A task ready for search: operators without conditional effects, and pairs that exclude each other."""

    task: Task
    operators: Sequence[GroundOperator]
    excluded: Sequence[Bits]
    seed: int


def backward(setting: Setting, effort: Effort) -> Answer | None:
    """Hill climbing while it is quick, then best first, which is complete."""
    regression = _Regression(setting)
    return _bounded(regression.climb, effort, CLIMB) or regression.best_first(effort)


def forward(setting: Setting, effort: Effort) -> Answer | None:
    """Lazy greedy search from the initial state."""
    return _forward(setting).run(effort)


def landmarks(setting: Setting, effort: Effort) -> Answer | None:
    """The same with queues ordered by landmarks beside those ordered by relaxed plans."""
    return _forward(setting, landmarks=True).run(effort)


def auto(setting: Setting, effort: Effort) -> Answer | None:
    """Regression while it is quick; then forward, with landmarks and best first backward in turns that double."""
    regression = _Regression(setting)
    ahead: dict[bool, Search] = {}

    def run_forward(part: Effort, with_landmarks: bool = False) -> Answer | None:
        if with_landmarks not in ahead:
            ahead[with_landmarks] = _forward(setting, landmarks=with_landmarks)
        return ahead[with_landmarks].run(part)

    def run_landmarks(part: Effort) -> Answer | None:
        return run_forward(part, with_landmarks=True)

    quick = _bounded(regression.climb, effort, CLIMB) or _bounded(regression.best_first, effort, QUICK)
    return quick or _in_turns(
        [(run_forward, FORWARD), (regression.best_first, REGRESSION), (run_landmarks, LANDMARKS)], effort
    )


def _bounded(run: Callable[[Effort], Answer | None], effort: Effort, most: int) -> Answer | None:
    """A search as long as it has generated no more than `most` nodes."""
    part = Effort(effort.limit, effort.interrupted, effort.expanded, most=most)
    answer = run(part)
    effort.expanded, effort.generated = part.expanded, effort.generated + part.generated
    return answer


STRATEGIES: dict[str, Callable[[Setting, Effort], Answer | None]] = {
    "auto": auto,
    "backward": backward,
    "forward": forward,
    "landmarks": landmarks,
}


class _Regression:
    """The backward searches of one task; what they need is made when it is first needed."""

    def __init__(self, setting: Setting) -> None:
        self.space: Backward = space(setting.task, setting.operators, setting.excluded)
        self.roots = [root for goal in setting.task.goals if (root := self.space.root(goal)) is not None]
        self._climb: Climb | None = None
        self._best_first: BestFirst | None = None

    def climb(self, effort: Effort) -> Answer | None:
        """Towards the first alternative of the goals; only with one alternative is its end a proof."""
        if not self.roots:
            return Answer(None, True)
        self._climb = self._climb or Climb(self.space, self.roots[0])
        answer = self._climb.run(effort)
        lost = answer is not None and answer.steps is None and len(self.roots) > 1
        return None if lost else answer

    def best_first(self, effort: Effort) -> Answer | None:
        """From all alternatives."""
        self._best_first = self._best_first or BestFirst(self.space, self.roots, GREED)
        return self._best_first.run(effort)


def _in_turns(turns: list[tuple[Callable[[Effort], Answer | None], int]], effort: Effort) -> Answer | None:
    """Run searches in turn, given with the expansions of their first turn, until one answers or the effort is spent."""
    factor = 1
    while not effort.spent():
        for run, length in turns:
            limit = min(effort.expanded + factor * length, effort.limit)
            part = Effort(limit, effort.interrupted, effort.expanded)
            answer = run(part)
            effort.expanded, effort.generated = part.expanded, effort.generated + part.generated
            if answer is not None:
                return answer
        factor *= 2
    return None


def _forward(setting: Setting, landmarks: bool = False) -> Search:
    """A forward search; several alternatives of the goals become one atom that internal operators add."""
    from engine.planning.forward import Forward  # compiled kernels are loaded only when they are needed

    task, size = setting.task, len(setting.task.atoms)
    if len(task.goals) == 1:
        return Forward(
            setting.operators, task.initial, task.goals[0], size, setting.seed, landmarks=landmarks
        )
    met = [GroundOperator(Function("_meets"), goal, 1 << size, 0, cost=0) for goal in task.goals]
    return _Stripped(
        Forward(
            [*setting.operators, *met], task.initial, 1 << size, size + 1, setting.seed, landmarks=landmarks
        ),
        len(setting.operators),
    )


@dataclass(frozen=True, slots=True)
class _Stripped:
    """A search whose operators from `first` on are internal and not part of its answer."""

    search: Search
    first: int

    def run(self, effort: Effort) -> Answer | None:
        answer = self.search.run(effort)
        if answer is None or answer.steps is None:
            return answer
        return Answer([step for step in answer.steps if step < self.first], False)
