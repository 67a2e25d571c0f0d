"""Straight free ways of a tool into many places at once."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.pipelines.moves.rooms import JUMP, Room
from cellwright.kb.model.cell import Place

KEPT = 6  # ways that are kept of a place
TRIED = 48  # free configurations whose way in is looked at
OF_A_BRANCH = (
    2  # ways that are kept of one branch: an arm with a large tool may not get from one branch to another
)
AT_ONCE = 8  # of them, those that are looked at together


@dataclass(eq=False)
class Ways:
    """The ways (m, k) into one place that were found, and the configurations (n, k) that this rests on."""

    place: Place
    poses: Floats
    free: Truths
    ways: list[Floats] = field(default_factory=list)
    looked: list[Floats] = field(default_factory=list)
    _next: int = 0
    _asked: int = 0
    _seen: int = 0

    def candidates(self) -> Iterator[int]:
        """The next free configurations whose ways are looked at; none if enough are known."""
        numbers, asked = np.nonzero(self.free)[0], 0
        while len(self.ways) < KEPT and asked < AT_ONCE and self._asked < TRIED and self._next < len(numbers):
            number = int(numbers[self._next])
            self._next += 1
            if not self._is_crowded(self.poses[number]):
                asked, self._asked = asked + 1, self._asked + 1
                yield number

    def take(self, number: int, path: Floats | None, room: Room) -> None:
        """Look at the way of one candidate, and keep it if it is free. Candidates come in order; one that is not needed is not
        looked at.
        """
        if len(self.ways) == KEPT or self._is_crowded(self.poses[number]):
            return
        self._see(number + 1)
        if path is not None:
            self.looked += list(path)
            if _is_free(room, self.place, path):
                self.ways.append(path)

    def close(self) -> None:
        """Unless enough ways were found before the end, the answer rests on every configuration."""
        if len(self.ways) < KEPT:
            self._see(len(self.poses))

    def _is_crowded(self, q: Floats) -> bool:
        """Whether enough ways end in the branch of a configuration (k,): the last joint does not make another branch."""
        same = [np.abs(path[-1][:-1] - q[:-1]).max(initial=0.0) <= JUMP for path in self.ways]
        return same.count(True) >= OF_A_BRANCH

    def _see(self, upto: int) -> None:
        self.looked += list(self.poses[self._seen : upto])
        self._seen = max(self._seen, upto)


def ways_into(room: Room, places: Sequence[Place]) -> list[Ways]:
    """For each place the straight ways in that are free, the nearest to the arm's rest first.

    The places take one arm, one tool, one approach, and touch the same. The answer for each is what it would be alone.
    """
    if not places:
        return []
    arm = places[0].arm
    poses = room.poses_at(places, room.world.configurations[arm])
    hits = room.collides(places[0], np.concatenate(poses))
    ends = np.cumsum([len(each) for each in poses])[:-1]
    found = [
        Ways(*each) for each in zip(places, poses, [~each for each in np.split(hits, ends)], strict=True)
    ]
    while rows := [(own, n) for own in found for n in own.candidates()]:
        starts = np.array([own.poses[n] for own, n in rows])
        paths = room.straights(places[0], starts, places[0].approach_m)
        for (own, n), path in zip(rows, paths, strict=True):
            own.take(n, path, room)
    for own in found:
        own.close()
    return found


def _is_free(room: Room, place: Place, path: Floats) -> bool:
    """Whether a path touches nothing that it may not: nothing at all where it begins."""
    front = room.whole(place.arm, path[:1])
    return not room.free(place.arm).collides(front)[0] and room.is_free(place, path)
