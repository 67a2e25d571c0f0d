"""Shortages: quantities of which the goals need more than there is, found by counting, without a
search.

Each fact that every plan has to make true is a landmark, and its achievers are the steps that make
it true (Porteous, Sebastia & Hoffmann 2001). What the cheapest achiever of each landmark uses adds
up, if the use of a step that serves several landmarks is shared among them (cost partitioning, Katz
& Domshlak 2010). Where steps use a fact up, it has to be made true again for each of them.

Quantities that stand for each other (two bottles of one reagent), or between which steps move
something (a bottle and its stock), are counted together. What some step gives back without taking
it from elsewhere is not counted: the search decides.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_axioms import UNBOUNDED_VALUE, QuantityLevel
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.kb.terms import Function

MAX_GOALS = 50  # alternatives of the goals; with more of them nothing is counted
MAX_LANDMARKS = 5_000
ROUNDS = 3  # how often facts that are used up are counted again


@dataclass(frozen=True, slots=True)
class Shortage:
    """Every plan moves `quantities` by `needed` in all, and only `available` lies between their
    starts and bounds.

    They are taken from, unless they `rise`. `starts` are their values at the start. Of what is
    there, only `usable` can be used, where steps take whole portions.
    """

    quantities: tuple[Function, ...]
    needed: int
    available: int
    usable: int
    starts: tuple[int, ...]
    rise: bool = False

    @property
    def missing(self) -> int:
        """How much more there would have to be."""
        return self.needed - (self.available if len(self.quantities) == 1 else self.usable)

    def __str__(self) -> str:
        names = " and ".join(map(str, self.quantities))
        together = " together" if len(self.quantities) > 1 else ""
        usable = f", of which {self.usable:,} can be used" if self.needed <= self.available else ""
        if self.rise:
            return (
                f"the goals need room for {self.needed:,} more in {names}{together}, and there "
                "is room for "
                f"{self.available:,}{usable}"
            )
        there = "there is 1" if self.available == 1 else f"there are {self.available:,}"
        return f"the goals need {self.needed:,} of {names}{together}, and {there}{usable}"


Group = tuple[QuantityLevel, ...]
"""Quantities that are counted together, because steps take from one or another of them, or move
from one to another.
"""


def shortages(task: GroundTask) -> tuple[Shortage, ...]:
    """The quantities of which every plan needs more than there is; none if another way to the
    goals has enough.
    """
    moves = _Moves(task.operators)
    if not moves.levels or not 0 < len(task.goals) <= MAX_GOALS:
        return ()
    first: tuple[Shortage, ...] = ()
    for goal in task.goals:
        lacking = tuple(_lacking(moves, _Count(task, goal, moves)))
        if not lacking:
            return ()
        first = first or lacking
    return first


def _lacking(moves: "_Moves", count: "_Count") -> Iterator[Shortage]:
    """What is short on the way to one goal.

    Quantities that are short by themselves are not told together again.
    """
    told: set[QuantityLevel] = set()
    for sign in (-1, 1):
        for group in moves.groups(count, sign):
            use = moves.uses(group, sign) if told.isdisjoint(group) else {}
            if use and (short := count.shortage(group, use, sign)):
                told.update(group)
                yield short


class _Moves:
    """How operators move quantities: for each level, by operator number, the least and the
    greatest step.
    """

    def __init__(self, operators: Sequence[GroundOperator]) -> None:
        self.levels: dict[QuantityLevel, dict[int, tuple[int, int]]] = {}
        for number, operator in enumerate(operators):
            for change in operator.changes:
                step = change.to.without(change.level).range()
                self.levels.setdefault(change.level, {})[number] = step

    def groups(self, count: "_Count", sign: int) -> tuple[Group, ...]:
        """Each quantity, then those that can stand for each other; each with those from which
        steps give something back.
        """
        alternatives = _Joined(self.levels)
        for atom in count.times:
            by_name: dict[str, list[QuantityLevel]] = {}
            for level in self._used_by(count.achievers[atom]):
                by_name.setdefault(level.quantity.name, []).append(level)
            for levels in by_name.values():
                alternatives.join(levels)
        groups = [*((each,) for each in self.levels), *alternatives.parts]
        return tuple(dict.fromkeys(self._completed(each, sign) for each in groups))

    def _completed(self, group: Group, sign: int) -> Group:
        """A group with the quantities from which steps move something into it, as long as there
        are any.
        """
        while giving := [number for number, use in self._net(group, sign).items() if use < 0]:
            end = 0 if sign < 0 else 1
            sources = [
                level
                for level, steps in self.levels.items()
                if level not in group
                and any(sign * steps[number][end] > 0 for number in giving if number in steps)
            ]
            if not sources:
                break
            group = tuple(sorted((*group, *sources), key=lambda level: level.number))
        return group

    def _used_by(self, numbers: Iterable[int]) -> list[QuantityLevel]:
        wanted = set(numbers)
        return [level for level, steps in self.levels.items() if not wanted.isdisjoint(steps)]

    def uses(self, group: Group, sign: int) -> dict[int, int]:
        """What each operator uses of a group at least; empty if a step gives something back, or
        nothing is bounded.
        """
        if any(
            each.low <= -UNBOUNDED_VALUE if sign < 0 else each.high >= UNBOUNDED_VALUE
            for each in group
        ):
            return {}
        found = self._net(group, sign)
        return found if all(each >= 0 for each in found.values()) else {}

    def _net(self, group: Group, sign: int) -> dict[int, int]:
        """What each operator takes from a group at least (-1), or brings into it (1)."""
        found: dict[int, int] = {}
        for level in group:
            for number, (low, high) in self.levels[level].items():
                found[number] = found.get(number, 0) + (-high if sign < 0 else low)
        return found

    def portion(self, level: QuantityLevel) -> int:
        """All steps move a quantity by multiples of this; 1 if that is not known."""
        steps = self.levels[level].values()
        return (
            gcd(*(low for low, _ in steps)) or 1 if all(low == high for low, high in steps) else 1
        )


class _Joined:
    """Disjoint sets of levels that grow together."""

    def __init__(self, levels: Iterable[QuantityLevel]) -> None:
        self._part: dict[QuantityLevel, list[QuantityLevel]] = {each: [each] for each in levels}

    def join(self, levels: Sequence[QuantityLevel]) -> None:
        """Puts the sets of some levels together."""
        for level in levels[1:]:
            one, another = self._part[levels[0]], self._part[level]
            if one is not another:
                one += another
                self._part |= dict.fromkeys(another, one)

    @property
    def parts(self) -> Iterator[Group]:
        """The sets, each with its levels in their order."""
        parts = {id(each): each for each in self._part.values()}
        return (tuple(sorted(each, key=lambda level: level.number)) for each in parts.values())


class _Count:
    """The landmarks of one of the ways to be at the goals, and how often each has to be made
    true, at least.
    """

    def __init__(self, task: GroundTask, goal: Bits, moves: _Moves) -> None:
        self.task, self.goal, self.moves = task, goal, moves
        self.times: dict[int, int] = {}
        derived = task.axioms.derived if task.axioms else 0
        waiting = [each for each in indices(goal & ~task.initial & ~derived)]
        while waiting and len(self.times) < MAX_LANDMARKS:
            atom = waiting.pop()
            if atom in self.times or not self.achievers.get(atom):
                continue
            self.times[atom] = 1
            common = -1
            for number in self.achievers[atom]:
                common &= task.operators[number].preconditions
            waiting += indices(common & ~task.initial & ~derived)

    @cached_property
    def achievers(self) -> dict[int, list[int]]:
        """The numbers of the operators that can make each atom true."""
        found: dict[int, list[int]] = {}
        for number, operator in enumerate(self.task.operators):
            added = operator.adds
            for effect in operator.conditional:
                added |= effect.adds
            for atom in indices(added):
                found.setdefault(atom, []).append(number)
        return found

    def shortage(self, group: Group, use: Mapping[int, int], sign: int) -> Shortage | None:
        """What is lacking of quantities that fall (-1) or rise (1), if each operator uses so
        much of them.
        """
        starts = tuple(each.of(self.task.initial) for each in group)
        rooms = [
            start - each.low if sign < 0 else each.high - start
            for each, start in zip(group, starts, strict=True)
        ]
        portions = map(self.moves.portion, group)
        usable = sum(room - room % portion for room, portion in zip(rooms, portions, strict=True))
        times = self.times
        for turn in range(ROUNDS + 1):
            if (needed := self._least(use, times)) > usable:
                names = tuple(each.quantity for each in group)
                return Shortage(names, needed, sum(rooms), usable, starts, sign > 0)
            if turn < ROUNDS:
                times = self._repeated(times, use)
        return None

    def _least(self, costs: Mapping[int, int], times: Mapping[int, int]) -> int:
        """The least total cost of steps that make all landmarks true so many times."""
        left, total = dict(costs), 0

        def cheapest(atom: int) -> int:
            return min(left.get(number, 0) for number in self.achievers[atom])

        first = {atom: cost for atom in times if (cost := cheapest(atom))}
        for atom in sorted(first, key=lambda each: (-first[each] * times[each], each)):
            if share := cheapest(atom):
                total += share * times[atom]
                for number in self.achievers[atom]:
                    left[number] -= share
        return total

    def _repeated(self, times: Mapping[int, int], use: Mapping[int, int]) -> dict[int, int]:
        """The times of landmarks once what their achievers use up is made true again for each of
        them.

        Only facts count that lead to the quantity: all that make them true use it, or use such a
        fact up.
        """
        found, operators = dict(times), self.task.operators
        wanted = self._giving(lambda number: use.get(number, 0) > 0)
        wanted |= self._giving(lambda number: bool(_used_up(operators[number]) & wanted))
        for atom in indices(wanted):
            bit = 1 << atom
            takers = {n: 1 for n in self._makers(times) if _used_up(operators[n]) & bit}
            if takers:
                taken = self._least(takers, times)
                again = taken - bool(self.task.initial & bit) + bool(taken and self.goal & bit)
                if again > found.get(atom, 0):
                    found[atom] = again
        return found

    def _makers(self, times: Mapping[int, int]) -> frozenset[int]:
        return frozenset(number for atom in times for number in self.achievers[atom])

    def _giving(self, costly: Callable[[int], bool]) -> Bits:
        """The atoms that only such operators make true."""
        found = 0
        for atom, numbers in self.achievers.items():
            if all(map(costly, numbers)):
                found |= 1 << atom
        return found


def _used_up(operator: GroundOperator) -> Bits:
    """What an operator needs and makes false, for sure."""
    kept = operator.adds
    for effect in operator.conditional:
        kept |= effect.adds
    return operator.preconditions & operator.deletes & ~kept
