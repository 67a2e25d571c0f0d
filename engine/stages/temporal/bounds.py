"""Lower bounds of the makespan over all plans, from the initial state alone.

A fact cannot be true before the soonest action that adds it may have (h-max over durations, as in
Haslum & Geffner 2001). Beside that, what must be done one after another takes the sum of its
durations: if each of some goals needs an action of its own, and all these actions take the same
fact at their start and give it back at their end, they cannot overlap.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from heapq import heapify, heappop, heappush

from cellwright.engine.model.temporal import GroundTimes, Span
from cellwright.engine.stages.temporal.formulas import constant
from cellwright.engine.stages.temporal.windows import Windows
from cellwright.kb.graphs import strong_components

MAX_ROUNDS = 12  # in which what must have ended is followed from action to action


def shortest_makespan(task: GroundTimes) -> Fraction | None:
    """No plan has a smaller makespan.

    None if the goal cannot be reached at all: that is a proof that no plan exists.
    """
    bounds = [bound for facts, _ in task.goals if (bound := _of(task, facts)) is not None]
    return min(bounds) if bounds else None


def _of(task: GroundTimes, goal: tuple[int, ...]) -> Fraction | None:
    paths = Paths(task)
    paths.spread()
    if any(fact not in paths.at for fact in goal):
        return None
    apart = _one_after_another(task, paths, goal)
    needed = max((paths.done.get(fact, Fraction(0)) for fact in goal), default=Fraction(0))
    return max(needed, apart)


class Paths:
    """The soonest time at which each fact can be added, and by which all that it needs has
    ended.
    """

    def __init__(self, task: GroundTimes) -> None:
        self.task = task
        self.windows = Windows.of(task, len(task.facts) + len(task.spans))
        self.at: dict[
            int, Fraction
        ] = {}  # when it is added; 0 and before `initial` for what is true at the start
        # when the actions that add it have ended, at the soonest
        self.done: dict[int, Fraction] = {}
        self.started: dict[int, Fraction] = {}
        self.ended: dict[int, Fraction] = {}
        self.initial = set(task.initial)
        mutual = mutual_holds(task.spans)
        self.needs = [
            self._needs(span, mutual.get(action, set())) for action, span in enumerate(task.spans)
        ]

    def spread(self) -> None:
        """Find the soonest times, from the start on."""
        users: dict[int, list[int]] = {}
        missing = list(map(len, self.needs))
        for action, needs in enumerate(self.needs):
            for fact in needs:
                users.setdefault(fact, []).append(action)
        queue = [(Fraction(0), fact) for fact in sorted(self.task.initial)]
        queue += [(timed.at, fact) for timed in self.task.timed for fact in timed.happening.adds]
        heapify(queue)
        for action in (each for each, count in enumerate(missing) if not count):
            self._fire(action, queue)
        while queue:
            time, fact = heappop(queue)
            if fact in self.at:
                continue
            self.at[fact] = time
            for action in users.get(fact, ()):
                missing[action] -= 1
                if not missing[action]:
                    self._fire(action, queue)
        self._endings()

    def _needs(self, span: Span, mutual: set[int]) -> set[int]:
        """What must be true before an action can start, or at once when it does.

        What starts together with it is left out.
        """
        held = {self.windows.needed(fact, span) for fact in span.holds if fact not in mutual}
        return {*span.start.needs, *held}

    def _fire(self, action: int, queue: list[tuple[Fraction, int]]) -> None:
        """An action can start: what it adds, and when.

        Its end may have to wait for more, which is left out.
        """
        span, epsilon = self.task.spans[action], self.task.epsilon
        start = Fraction(0)
        for fact in span.start.needs:
            start = max(start, self.at[fact] + (0 if fact in self.initial else epsilon))
        for fact in self.needs[action] - set(span.start.needs):
            start = max(start, self.at[fact])
        end = start + (least_length(span))
        self.started[action], self.ended[action] = start, end
        for fact in (*span.start.adds, *self.windows.gives(action)):
            heappush(queue, (start, fact))
        for fact in span.end.adds:
            heappush(queue, (end, fact))

    def _endings(self) -> None:
        """For each fact: the soonest end of an action that adds it.

        A plan ends only after all its actions.
        """
        for fact in self.initial:
            self.done[fact] = Fraction(0)
        adders: dict[int, list[int]] = {}
        for action in self.ended:
            span = self.task.spans[action]
            for fact in {*span.start.adds, *span.end.adds, *self.windows.gives(action)}:
                adders.setdefault(fact, []).append(action)
        self.finished = dict(self.ended)
        given = {fact for timed in self.task.timed for fact in timed.happening.adds}
        for _ in range(MAX_ROUNDS):
            before = dict(self.finished)
            self._finish(adders)
            self.done.update(dict.fromkeys(given, Fraction(0)))
            if self.finished == before:
                return

    def _finish(self, adders: dict[int, list[int]]) -> None:
        """Once more: no fact before an action that adds it has ended, no action before what it
        needs was added in that way.
        """
        for fact, actions in adders.items():
            if fact not in self.initial:
                soonest = min(self.finished[action] for action in actions)
                self.done[fact] = max(self.done.get(fact, Fraction(0)), soonest)
        for action in self.ended:
            latest = max(
                (self.done.get(fact, Fraction(0)) for fact in self.needs[action]),
                default=Fraction(0),
            )
            self.finished[action] = max(self.ended[action], latest)


def mutual_holds(spans: Sequence[Span]) -> dict[int, set[int]]:
    """For each action the facts that it holds and that a start may add together with its own
    start: two actions may each hold what the start of the other adds.
    """
    starters: dict[int, list[int]] = {}
    for action, span in enumerate(spans):
        for fact in span.start.adds if span.holds else ():
            starters.setdefault(fact, []).append(action)
    # facts are negative in the graph, and point at the actions whose starts add them
    graph: dict[int, list[int]] = {-1 - fact: actions for fact, actions in starters.items()}
    for action in {each for actions in starters.values() for each in actions}:
        graph[action] = [-1 - fact for fact in spans[action].holds if fact in starters]
    result: dict[int, set[int]] = {}
    for component in strong_components(graph):
        facts = {-1 - vertex for vertex in component if vertex < 0}
        result |= {vertex: facts for vertex in component if vertex >= 0 and facts}
    return result


def least_length(span: Span) -> Fraction:
    """The shortest duration of an action; 0 where that depends on numbers."""
    value = constant(span.shortest)
    return max(value, Fraction(0)) if value is not None else Fraction(0)


def _one_after_another(task: GroundTimes, paths: Paths, goal: Iterable[int]) -> Fraction:
    """The sum of the durations of actions that some goals need, one for each, and that exclude
    each other.
    """
    wanted: dict[int, list[int]] = {fact: [] for fact in goal if fact not in task.initial}
    for timed in task.timed:
        for fact in timed.happening.adds:
            wanted.pop(fact, None)
    for action in paths.ended:
        span = task.spans[action]
        for fact in {*span.start.adds, *span.end.adds}:
            if fact in wanted:
                wanted[fact].append(action)
    shared = {fact for timed in task.timed for fact in timed.happening.adds}
    for span in task.spans:  # who adds such a fact without having taken it makes it no resource
        shared |= {*span.start.adds, *span.end.adds} - _taken(span)
    takers = {
        fact
        for actions in wanted.values()
        for action in actions
        for fact in _taken(task.spans[action])
    }
    return max(
        (_chain(task, taken, wanted) for taken in sorted(takers - shared)), default=Fraction(0)
    )


def _chain(task: GroundTimes, taken: int, wanted: dict[int, list[int]]) -> Fraction:
    """The least time of the goals whose every action takes one fact.

    Each action counts for one goal alone.
    """
    used: set[int] = set()
    lengths = []
    for actions in wanted.values():
        spans = [task.spans[action] for action in actions]
        if actions and all(taken in _taken(span) for span in spans) and not used & set(actions):
            used |= set(actions)
            lengths.append(min(map(least_length, spans)))
    return sum(lengths, Fraction(0)) + task.epsilon * max(0, len(lengths) - 1)


def _taken(span: Span) -> set[int]:
    """The facts that an action needs and deletes at its start, and that only its end gives back."""
    if span.instantaneous:
        return set()
    return (set(span.start.needs) & set(span.start.deletes) & set(span.end.adds)) - set(
        span.start.adds
    )
