"""In which order visits of several arms can begin, where some wait for those of other arms."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.tour import Shares, TourProblem
from cellwright.engine.stages.sequencing.shares import part

Pair = tuple[str, str]  # of measurements: the first comes before the second


def of_share(problem: TourProblem, names: Sequence[str]) -> TourProblem:
    """The tour problem of some measurements, in this order."""
    place = {visit.name: n for n, visit in enumerate(problem.visits)}
    return part(problem, [place[name] for name in names])


def merged(
    problems: Mapping[str, TourProblem], found: Shares, waits: Sequence[Pair]
) -> tuple[str, ...] | None:
    """All visits by when they can begin; None if they wait in a circle."""
    behind = dict[str, list[str]]()
    for first, second in waits:
        behind.setdefault(second, []).append(first)
    ended, order = dict[str, int](), list[str]()
    left = {arm: _Left(of_share(problems[arm], own)) for arm, own in found.orders.items() if own}
    while left:
        ready = [
            (max([own.clock, *(ended[each] for each in behind.get(own.next, ()))]), arm)
            for arm, own in left.items()
            if all(each in ended for each in behind.get(own.next, ()))
        ]
        if not ready:
            return None
        begins, arm = min(ready)
        own = left[arm]
        name = own.next
        order.append(name)
        ended[name] = own.went_on(begins)
        if own.at == len(own.problem.visits):
            del left[arm]
    return tuple(order)


@dataclass
class _Left:
    """What an arm has not begun yet: it is at visit `at` of its share at `clock`."""

    problem: TourProblem
    at: int = 0
    clock: int = 0

    @property
    def next(self) -> str:
        return self.problem.visits[self.at].name

    def went_on(self, begins: int) -> int:
        """Make the next visit, and go to the one behind it; when it has ended."""
        ended, n = begins + self.problem.visits[self.at].duration, self.at
        self.at += 1
        way = self.problem.lengths((n, n + 1))[0] if self.at < len(self.problem.visits) else 0
        self.clock = ended + way
        return ended


def waits_of(
    pairs: Sequence[Pair],
    problems: Mapping[str, TourProblem],
    found: Shares,
    arms: Mapping[str, str],
) -> Iterator[Pair]:
    """Pairs of visits of different arms: those of `before`, and from one step of the alignment to the next."""
    for first, second in pairs:
        if first in arms and second in arms and arms[first] != arms[second]:
            yield first, second
    phases = {v.name: v.phase for p in problems.values() for v in p.visits}
    aligning = sorted({phases[name] for name in arms if phases[name] < 0})
    for phase in aligning:
        for arm, own in found.orders.items():
            last = [name for name in own if phases[name] <= phase][-1:]
            for other, theirs in found.orders.items():
                after = [name for name in theirs if phases[name] > phase][:1]
                if last and after and arm != other:
                    yield last[0], after[0]


def levels_of(pairs: Sequence[Pair]) -> dict[str, int]:
    """How many measurements must come before each at least, one after the other."""
    level = dict[str, int]()
    for _ in range(len(pairs) + 1):
        for first, second in pairs:
            level[second] = max(level.get(second, 0), level.get(first, 0) + 1)
    return level


def levelled(problem: TourProblem, levels: Mapping[str, int]) -> TourProblem:
    """The tour of an arm in the order of levels, so that arms never wait in a circle: who waits is always on a higher one."""
    depth = max(levels.values(), default=0) + 1
    visits = (replace(v, phase=v.phase * depth + levels.get(v.name, 0) - depth) for v in problem.visits)
    return replace(problem, visits=tuple(visits))
