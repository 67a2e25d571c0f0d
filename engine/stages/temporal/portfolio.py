"""Plans in time by several searches in turns, and then makes the makespan smaller.

Each search has its own balance of three things: how much is left to do, when it would end, and
whether relaxed plans prefer what is soon to what is cheap. Searches get more expansions with every
round. Once there is a plan, turns go to searches below its makespan: from the start, and from a
point within the plan (large neighbourhoods), and to moves of single instants.
"""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from cellwright.engine.kernels.cancellation import Interrupted, Poll
from cellwright.engine.model.temporal import GroundTimes
from cellwright.engine.stages.temporal.bounds import shortest_makespan
from cellwright.engine.stages.temporal.instant_search import InstantSearch
from cellwright.engine.stages.temporal.tables import Tables, tables
from cellwright.engine.stages.temporal.timed_relaxation import TimedRelaxation
from cellwright.engine.stages.temporal.timeline import Timeline
from cellwright.kb.model.durative import TimedPlan, TimedStep

UNREACHED = 1 << 60  # the cost, or the makespan, of what no plan reaches
MAX_NODES = 30_000_000  # of one search: some 500 MB
FIRST_TURN = 1000  # expansions of each search in the first round
MANY = 100_000  # expansions of a turn from which on all manners seek a first plan
SWEEP = 4000  # expansions of each first manner, once there is a plan
# rounds of improvement without success after which an effort that is not thorough ends
STALE_ROUNDS = 40


@dataclass(frozen=True, slots=True)
class Manner:
    """How a search weighs the end of its relaxed plans, how much relaxed plans prefer what is
    soon, and what it may try.

    With `lags`, states differ where actions that must end in time have begun at other times.
    """

    weight: float
    slope: float
    greedy: bool = False
    newest: bool = False
    lags: bool = False


FIRST = (  # the manners that seek a first plan, one after another
    Manner(0, 0),
    Manner(0, 0, newest=True),
    Manner(0.25, 0.75),
    Manner(0, 0.1),
    Manner(3, 2),
    Manner(0, 0, lags=True),
)
MANNERS = (
    *FIRST,
    Manner(1, 0.2),
    Manner(0, 0, greedy=True),
    Manner(0.05, 0.3, newest=True),
    Manner(0.5, 0.05),
    Manner(0.1, 1, greedy=True, newest=True),
    Manner(0, 0.7),
    Manner(2, 0.02, greedy=True),
)


@dataclass
class TimeOutcome:
    """The best sequence and its makespan; without one, whether it is proved that none exists.

    `bound` holds for all plans.
    """

    plan: TimedPlan | None
    bound: Fraction
    proved_none: bool = False
    counts: dict[str, int] = field(default_factory=dict)


def plan_over_time(
    task: GroundTimes,
    interrupted: Interrupted,
    seed: int = 0,
    thorough: bool = False,
    improved: Callable[[TimedPlan], None] = lambda _: None,
    most: int = 10**9,
) -> TimeOutcome:
    """The best plan found before `interrupted`, or, where the effort is not `thorough`, until
    nothing gets better.
    """
    bound = shortest_makespan(task)
    if bound is None:
        return TimeOutcome(None, Fraction(0), proved_none=True)
    return Turns(task, tables(task), bound, Poll(interrupted), seed, improved).run(thorough, most)


class Turns:
    """Gives searches their turns."""

    def __init__(
        self,
        task: GroundTimes,
        arrays: Tables,
        bound: Fraction,
        poll: Poll,
        seed: int,
        improved: Callable[[TimedPlan], None],
    ) -> None:
        self.task, self.arrays, self.bound, self.poll, self.improved = (
            task,
            arrays,
            bound,
            poll,
            improved,
        )
        self.line, self.guide = Timeline(arrays.parts), TimedRelaxation(arrays.parts)
        self.search = InstantSearch(self.line, self.guide, poll)
        self.random = random.Random(seed)
        self.best: list[int] | None = None
        self.makespan = UNREACHED
        self.floor = -(-bound.numerator * arrays.scale // bound.denominator)
        self.counts = {"searches": 0, "expansions": 0, "moves": 0}
        # whether other actions can come between the start and the end of one that must end in time
        self.lagged = any(
            span.longest is not None and not whole
            for span, whole in zip(task.spans, arrays.whole, strict=True)
        )
        self.ratio = self._choose_goal()

    def _choose_goal(self) -> float:
        """Aim at the alternative of the goal that seems cheapest; what a relaxed plan costs in
        the unit of its end.
        """
        self.alternatives = []
        for place in range(len(self.task.goals)):
            self.line.reset()
            self.guide.goals = self.arrays.goals(place)
            cost = self.guide.evaluate(self.line)
            self.alternatives.append((cost, self.guide.estimate, place))
        self.alternatives.sort()
        cost, estimate, place = self.alternatives[0]
        self.guide.goals = self.arrays.goals(place)
        return max(cost, 1) / max(estimate, 1) if cost < UNREACHED else 1.0

    def run(self, thorough: bool, most: int) -> TimeOutcome:
        """A first plan, then better ones."""
        turn = FIRST_TURN
        while self.best is None and not self.poll.check() and self.counts["expansions"] < most:
            for manner in self._manners(FIRST if turn < MANY else MANNERS):
                for _, _, place in self.alternatives[:4]:
                    self.guide.goals = self.arrays.goals(place)
                    self._search((), manner, turn)
                    if self.best is not None or self.poll.check():
                        break
                if self.best is not None or self.poll.check():
                    break
            turn *= 3
        if self.best is not None:
            self._improve(thorough, most)
        plan = self.plan_of(self.best) if self.best is not None else None
        return TimeOutcome(plan, self.bound, counts=self.counts)

    def _search(self, prefix: Sequence[int], manner: Manner, most: int, cut: bool = False) -> bool:
        """One search from a prefix, below the best makespan; whether it found a better plan."""
        search = self.search
        search.weight, self.guide.slope = manner.weight * self.ratio, manner.slope * self.ratio
        search.greedy, search.newest_first, search.cut = manner.greedy, manner.newest, cut
        self.line.keeps_lags = manner.lags
        search.tie = self.random.randrange(1, 1 << 30)
        codes = search.run(prefix, self.makespan, most, MAX_NODES)
        self.counts["searches"] += 1
        self.counts["expansions"] += search.expanded
        return codes is not None and self._take(codes)

    def _take(self, codes: Sequence[int]) -> bool:
        """Keep a sequence if it is better than the best; whether it is."""
        makespan = self.evaluate(codes)
        if makespan >= self.makespan:
            return False
        self.best, self.makespan = list(codes), makespan
        self.improved(self.plan_of(self.best))
        return True

    def evaluate(self, codes: Sequence[int]) -> int:
        """The makespan of a sequence with all that happens by itself; `UNREACHED` if it is no
        plan.
        """
        line = self.line
        line.reset()
        for code in codes:
            if not line.apply(code):
                return UNREACHED
        if line.opened:
            return UNREACHED
        for change in range(line.passed, line.changes):
            if not line.apply(2 * line.actions + change):
                return UNREACHED
        return (
            int(line.makespan)
            if any(map(self._is_reached, range(len(self.task.goals))))
            else UNREACHED
        )

    def _is_reached(self, place: int) -> bool:
        """Whether an alternative of the goal holds in the state of the timeline."""
        facts, tests = self.task.goals[place]
        if not all(self.line.state[fact] for fact in facts):
            return False
        return not tests or self._tests_hold(place)

    def _tests_hold(self, place: int) -> bool:
        self.guide.goals = self.arrays.goals(place)
        return self.guide.evaluate(self.line) == 0

    def _improve(self, thorough: bool, most: int) -> None:
        """Turns for what may make the plan shorter, until nothing does."""
        for manner in self._manners(FIRST):
            if self.makespan > self.floor and self.counts["expansions"] < most:
                self._search((), manner, SWEEP)
        stale, step = 0, 0
        while (
            self.makespan > self.floor
            and not self.poll.check()
            and self.counts["expansions"] < most
        ):
            if not thorough and stale >= STALE_ROUNDS:
                return
            before = self.makespan
            if step % 4 == 0:
                self._search(
                    (), self._manner(), 1000 + 50 * min(stale, 200), cut=self.random.random() < 0.3
                )
            elif step % 4 == 1:
                self._move(400)
            else:
                self._from_within(300 + 10 * min(stale, 100))
            step += 1
            stale = 0 if self.makespan < before else stale + 1

    def _manners(self, manners: Sequence[Manner]) -> list[Manner]:
        """Those of the manners that can make a difference."""
        return [manner for manner in manners if self.lagged or not manner.lags]

    def _manner(self) -> Manner:
        """One of the manners, with other weights."""
        base = self.random.choice(self._manners(MANNERS))
        factor = 4 ** self.random.uniform(-1, 1)
        weight = base.weight * factor + (0.02 if self.random.random() < 0.3 else 0)
        return Manner(
            weight,
            base.slope * 4 ** self.random.uniform(-1, 1),
            base.greedy,
            self.random.random() < 0.5,
            base.lags,
        )

    def _from_within(self, most: int) -> None:
        """Search again from a point in the best plan."""
        assert self.best is not None
        cut = self.random.randrange(len(self.best) + 1)
        self._search(self.best[:cut], self._manner(), most, cut=self.random.random() < 0.3)

    def _move(self, tries: int) -> None:
        """Leave instants out, or move them to other places in the sequence."""
        assert self.best is not None
        codes, makespan = list(self.best), self.makespan
        for _ in range(tries):
            if not codes or self.poll.due(200_000):
                return
            self.counts["moves"] += 1
            other = self._moved(codes)
            value = self.evaluate(other)
            if value < makespan or (value == makespan and self.random.random() < 0.5):
                codes = other
                if value < makespan:
                    makespan = value
                    self._take(codes)

    def _moved(self, codes: list[int]) -> list[int]:
        other = list(codes)
        place = self.random.randrange(len(other))
        code = other.pop(place)
        if self.random.random() < 0.15:
            return [
                each
                for each in other
                if each not in (code - self.line.actions, code + self.line.actions)
            ]
        spread = max(2, len(other) // (1 if self.random.random() < 0.2 else 8))
        other.insert(min(len(other), max(0, place + self.random.randint(-spread, spread))), code)
        return other

    def plan_of(self, codes: Sequence[int]) -> TimedPlan:
        """The steps of a sequence, at their earliest times."""
        line, spans, scale = self.line, self.task.spans, self.arrays.scale
        line.reset()
        nodes: list[tuple[int, int, int]] = []
        for code in codes:
            first = line.nodes
            line.apply(code)
            if code < line.actions:
                nodes.append((code, first, first if spans[code].instantaneous else first + 1))
        for change in range(line.passed, line.changes):
            line.apply(2 * line.actions + change)
        times = line.times
        steps = [
            TimedStep(
                Fraction(times[start], scale),
                spans[code].name,
                Fraction(times[end] - times[start], scale),
            )
            for code, start, end in nodes
        ]
        return TimedPlan(tuple(sorted(steps, key=lambda step: (step.start, str(step.action)))))


__all__ = ["TimeOutcome", "plan_over_time"]
