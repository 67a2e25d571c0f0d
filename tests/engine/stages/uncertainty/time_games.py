"""Random networks with uncertain links, and the game that says by brute force who wins on them."""

import itertools
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from cellwright.engine.model.uncertain_times import (
    DifferenceBound,
    UncertainLink,
    UncertainNetwork,
)

NEVER = 10**6


def random_network(
    seed: int, links: int | None = None, spare: int = 4, least: int = 0, longest: int = 8
) -> UncertainNetwork:
    """A network whose bounds are drawn; about a third of them have a policy."""
    chance = random.Random(seed)
    count = chance.randint(0, 4) if links is None else links
    size = chance.randint(2 * count + 2, 2 * count + 1 + max(1, spare))
    points = list(range(1, size))
    chance.shuffle(points)
    ends, rest = points[:count], [0, *points[count:]]
    drawn = []
    for place, end in enumerate(ends):
        start = chance.choice(rest + ends[:place] if chance.random() < 0.4 else rest)
        shortest = chance.randint(least, least + longest - 2)
        drawn.append(UncertainLink(start, end, shortest, shortest + chance.randint(0, longest)))
    bounds = [DifferenceBound(point, 0, 0) for point in range(1, size)]
    for _ in range(chance.randint(size // 2, 2 * size)):
        one, other = chance.sample(range(size), 2)
        bounds.append(DifferenceBound(one, other, chance.randint(-longest + 2, 2 * longest - 2)))
    return UncertainNetwork(tuple(map(str, range(size))), tuple(bounds), tuple(drawn))


def has_winning_policy(network: UncertainNetwork) -> bool:
    """Whether the one who acts wins against whoever ends the links, at whole times.

    At each time first the links end that are chosen to end, then points are executed one by one.
    Then links may end once more: that stands for a moment later, since time is dense, and who has
    acted at a time does not know what ends right after it.
    """
    return _Game(network).won()


@dataclass(frozen=True, slots=True)
class _Position:
    """What is left: for each open point from when to when it may be, from now on; and how old each
    link under way is.
    """

    windows: tuple[tuple[int, int] | None, ...]
    ages: tuple[int, ...]  # -1: not begun, -2: over


@dataclass
class _Game:
    network: UncertainNetwork
    known: dict[_Position, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = range(len(self.network.points))
        self.most = [[0 if one == other else NEVER for other in size] for one in size]
        for bound in self.network.bounds:
            row = self.most[bound.earlier]
            row[bound.later] = min(row[bound.later], bound.most)
        for link in self.network.links:
            self.most[link.start][link.end] = min(self.most[link.start][link.end], link.most)
            self.most[link.end][link.start] = min(self.most[link.end][link.start], -link.least)
        for middle, one, other in itertools.product(size, size, size):
            by = self.most[one][middle] + self.most[middle][other]
            self.most[one][other] = min(self.most[one][other], by)
        self.ends = {link.end: number for number, link in enumerate(self.network.links)}

    def won(self) -> bool:
        size = range(len(self.network.points))
        if any(self.most[point][point] < 0 for point in size):
            return False
        windows = tuple((-NEVER, NEVER) for _ in size)
        start = self._executed(_Position(windows, (-1,) * len(self.network.links)), 0)
        return start is not None and self._act(start)

    def _executed(self, position: _Position, point: int) -> _Position | None:
        """What is left when a point happens now; None if that breaks a bound."""
        window = position.windows[point]
        if window is None or not window[0] <= 0 <= window[1]:
            return None
        windows = list(position.windows)
        windows[point] = None
        for other, known in enumerate(windows):
            if known is not None:
                least, most = -self.most[other][point], self.most[point][other]
                low, high = max(known[0], least), min(known[1], most)
                if high < max(low, 0):
                    return None
                windows[other] = (max(low, -1), high if high < NEVER // 2 else NEVER)
        ages = list(position.ages)
        for number, link in enumerate(self.network.links):
            if link.start == point:
                ages[number] = 0
        if point in self.ends:
            ages[self.ends[point]] = -2
        return _Position(tuple(windows), tuple(ages))

    def _act(self, position: _Position) -> bool:
        """Whether who acts wins when it is their turn."""
        if all(window is None for window in position.windows):
            return True
        if position not in self.known:
            self.known[position] = False  # who comes here again has only waited
            self.known[position] = self._wins(position)
        return self.known[position]

    def _wins(self, position: _Position) -> bool:
        if self._all_answers(
            position, lambda after: self._go_on(after) if after == position else self._act(after)
        ):
            return True
        for point, window in enumerate(position.windows):
            if window is None or point in self.ends:
                continue
            after = self._executed(position, point)
            if after is not None and self._act(after):
                return True
        return False

    def _go_on(self, position: _Position) -> bool:
        """Whether who acts wins by letting the time pass until something may change."""
        windows = []
        for window in position.windows:
            if window is None:
                windows.append(None)
                continue
            low, high = max(window[0] - 1, -1), window[1] - (window[1] < NEVER)
            if high < 0:
                return False
            windows.append((low, high))
        ages = tuple(age + 1 if age >= 0 else age for age in position.ages)
        later = _Position(tuple(windows), ages)
        return self._all_answers(later, self._act)

    def _all_answers(self, position: _Position, following: Callable[[_Position], bool]) -> bool:
        """Whether who acts wins whichever links end now."""
        able, forced = [], []
        for number in range(len(position.ages)):
            link, age = self.network.links[number], position.ages[number]
            if age >= link.least:
                (forced if age >= link.most else able).append(number)
        for count in range(len(able) + 1):
            for some in itertools.combinations(able, count):
                after: _Position | None = position
                for number in (*forced, *some):
                    after = after and self._executed(after, self.network.links[number].end)
                if after is None or not following(after):
                    return False
        return True
