# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Search over orders and poses together.

The poses of all visits are in one table (m, k) of joint values divided by joint speeds. So the time
between two poses is their largest difference. The poses of visit v are the rows offset[v] ..
offset[v + 1] - 1. A tour is a ring of visits (`after`, `before`) with a row for each visit
(`pose`).

Ruin and recreate (Schrimpf et al. 2000); each insertion chooses a pose, as Smith & Imeson 2017
(GLNS) do for generalised tours. The layered shortest path over poses is that of Suarez-Ruiz,
Lembono & Pham 2018.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, real, whole
from cellwright.engine.stages.sequencing.kernels.twister import Stream

BIG = 1e300
MOST = 12  # the greatest number of visits that one round removes
NOISE = 0.2  # how far the choice of a place may err


def best_poses(order: Ints, table: Floats, offset: Ints, closed: bool, pose: Ints) -> float:
    """The least time of an order over all choices of poses.

    The rows that give it are written into `pose` (n,), by visit. A closed tour is cut at its first
    visit, and the path is computed for each of its poses. So the first visit should have few poses.
    """
    return Layers(order, table, offset, pose).best(closed)


def search(
    order: Ints,
    pose: Ints,
    table: Floats,
    offset: Ints,
    near: Ints,
    rounds: int,
    warmth: float,
    cooling: float,
    seed: int,
) -> tuple[Ints, Ints, float, Ints, Ints, float]:
    """Ruin and recreate a closed tour for `rounds` rounds, with annealing; n >= 8.

    `order` (n,) and `pose` (n,) are the tour; `near` (n, k) has the visits beside which a visit may
    be inserted. Returns the best order, its poses and time, the current order and poses, and the
    final warmth.
    """
    ruins = Ruins(order, pose, table, offset, near, seed)
    warmth = ruins.run(rounds, warmth, cooling)
    best, now = np.array(ruins.kept_after), np.array(ruins.after)
    kept, row = np.array(ruins.kept_pose), np.array(ruins.pose)
    return _order_of(best, order[0]), kept, ruins.best, _order_of(now, order[0]), row, warmth


def _order_of(after: Ints, first: int) -> Ints:
    """The visits on a ring, starting at the first."""
    order, visit = np.empty(len(after), np.int32), first
    for place in range(len(after)):
        order[place] = visit
        visit = after[visit]
    return order


def _check(order: Ints, table: Floats, offset: Ints, pose: Ints) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    n = len(order)
    if n < 1 or not np.array_equal(np.sort(order), np.arange(n)) or pose.shape != (n,):
        raise ValueError("an order (n,) of all visits, and a row (n,) for each, were expected")
    if (
        offset.shape != (n + 1,)
        or offset[0] < 0
        or offset[n] > len(table)
        or np.diff(offset).min() < 1
    ):
        raise ValueError("each visit needs rows of the table of poses")


class Poses:
    """The table of poses, and the row at which the poses of each visit begin."""

    def __init__(self, table: Floats, offset: Ints) -> None:
        self.table, self.offset, self.joints = real(table), whole(offset), table.shape[1]

    def travel(self, a: int, b: int) -> float:
        """The time from one pose to another."""
        most = 0.0
        for joint in range(self.joints):
            most = max(most, abs(self.table[a, joint] - self.table[b, joint]))
        return most

    def width(self, visit: int) -> int:
        """The number of poses of a visit."""
        return self.offset[visit + 1] - self.offset[visit]


class Layers:
    """Shortest paths over the poses of visits in a given order; the best rows are written into
    `pose` (n,).
    """

    def __init__(self, order: Ints, table: Floats, offset: Ints, pose: Ints) -> None:
        _check(order, table, offset, pose)
        self.poses, self.order, self.pose = Poses(table, offset), whole(order), whole(pose)
        self.n, widest = len(order), int(np.diff(offset).max())
        self.value, self.following = real(np.zeros(widest)), real(np.zeros(widest))
        self.back = whole(np.zeros((self.n, widest), np.int32))
        self.last, self.origin = 0, 0

    def best(self, closed: bool) -> float:
        """The least time over all choices of poses."""
        best, choices = BIG, 1
        if closed:
            choices = self.poses.width(self.order[0])
        for choice in range(choices):
            total = self._pass(choice if closed else -1)
            if total >= best:
                continue
            best, last = total, self.last
            for place in range(self.n - 1, -1, -1):
                self.pose[self.order[place]] = self.poses.offset[self.order[place]] + last
                last = self.back[place, last]
        return best

    def _pass(self, fixed: int) -> float:
        """The time of a shortest path to its last pose `last`; with `fixed` >= 0, from this pose
        and back to it.
        """
        home = self.poses.offset[self.order[0]]
        start, count = home, self.poses.width(self.order[0])
        for pose in range(count):
            self.value[pose] = 0.0 if fixed in (-1, pose) else BIG
        for place in range(1, self.n):
            low, width = self.poses.offset[self.order[place]], self.poses.width(self.order[place])
            for pose in range(width):
                self.following[pose] = self._from_before(start, count, low + pose)
                self.back[place, pose] = self.origin
            for pose in range(width):
                self.value[pose] = self.following[pose]
            start, count = low, width
        total, self.last = BIG, 0
        for pose in range(count):
            back = self.value[pose]
            if fixed >= 0 and back < BIG:
                back += self.poses.travel(start + pose, home + fixed)
            if back < total:
                total, self.last = back, pose
        return total

    def _from_before(self, start: int, count: int, row: int) -> float:
        """The least time to a row from the `count` rows at `start`; `origin` becomes the row
        before it.
        """
        least, self.origin = BIG, 0
        for earlier in range(count):
            if self.value[earlier] < least:
                time = self.value[earlier] + self.poses.travel(start + earlier, row)
                if time < least:
                    least, self.origin = time, earlier
        return least


class Ruins:
    """A closed tour that is ruined and recreated; `kept_after`, `kept_pose` and `best` are the
    best so far.
    """

    def __init__(
        self, order: Ints, pose: Ints, table: Floats, offset: Ints, near: Ints, seed: int
    ) -> None:
        _check(order, table, offset, pose)
        n = self.n = len(order)
        if (
            n < 8
            or near.ndim != 2
            or len(near) != n
            or not near.size
            or not 0 <= near.min() <= near.max() < n
        ):
            raise ValueError("eight visits or more, and for each the visits near it, were expected")
        if not 0 <= pose.min() <= pose.max() < len(table):
            raise ValueError("poses are numbered by the rows of the table")
        self.poses, self.stream = Poses(table, offset), Stream(seed)
        self.near, self.breadth = whole(near), near.shape[1]
        after, before = np.empty(n, np.int32), np.empty(n, np.int32)
        after[order], before[order] = np.roll(order, -1), np.roll(order, 1)
        self.after, self.old_after, self.kept_after = (whole(after.copy()) for _ in range(3))
        self.before, self.old_before = whole(before), whole(before.copy())
        self.pose, self.old_pose, self.kept_pose = (whole(pose.copy()) for _ in range(3))
        self.removed, self.chosen, self.best = whole(np.zeros(n, np.int32)), -1, 0.0

    def run(self, rounds: int, warmth: float, cooling: float) -> float:
        """Make this many rounds with annealing. Returns the final warmth."""
        now = self.best = self._time()
        for _ in range(rounds):
            warmth *= cooling
            self._remember()
            count = self._ruin()
            self._recreate(count)
            time = self._time()
            if time < now or self.stream.accepts((now - time) / max(warmth, 1e-12)):
                now = time
                if now < self.best - 1e-12:
                    self.best = now
                    self._keep()
            else:
                self._return()
        return warmth

    def _time(self) -> float:
        """The time of the tour."""
        total = 0.0
        for visit in range(self.n):
            total += self.poses.travel(self.pose[visit], self.pose[self.after[visit]])
        return total

    def _remember(self) -> None:
        """Note the tour before a change."""
        for visit in range(self.n):
            self.old_after[visit], self.old_before[visit] = self.after[visit], self.before[visit]
            self.old_pose[visit] = self.pose[visit]

    def _return(self) -> None:
        """Go back to the tour before the change."""
        for visit in range(self.n):
            self.after[visit], self.before[visit] = self.old_after[visit], self.old_before[visit]
            self.pose[visit] = self.old_pose[visit]

    def _keep(self) -> None:
        """Keep the tour as the best one."""
        for visit in range(self.n):
            self.kept_after[visit], self.kept_pose[visit] = self.after[visit], self.pose[visit]

    def _ruin(self) -> int:
        """Remove some neighbouring visits, or a stretch of the tour, from the ring.

        Returns their number.
        """
        count = min(1 + self.stream.below(MOST), self.n - 3)
        visit = seed = self.stream.below(self.n)
        along, taken = self.stream.random() < 0.5, 0
        for attempt in range(4 * count):
            if taken == count:
                break
            if self.after[visit] >= 0:
                following = self.after[visit]
                self.after[self.before[visit]], self.before[following] = (
                    following,
                    self.before[visit],
                )
                self.after[visit] = -1
                self.removed[taken] = visit
                taken += 1
                if along:
                    visit = following
                    continue
            source = seed
            if taken and attempt % 2:
                source = self.removed[self.stream.below(taken)]
            visit = self.near[source, self.stream.below(self.breadth)]
        return taken

    def _recreate(self, count: int) -> None:
        """Insert the visits again in random order, then choose their poses and their
        neighbours' poses.
        """
        for last in range(count - 1, 0, -1):
            other = self.stream.below(last + 1)
            self.removed[last], self.removed[other] = self.removed[other], self.removed[last]
        for place in range(count):
            self._insert(self.removed[place])
        for place in range(count):
            visit = self.removed[place]
            self._polish(self.before[visit])
            self._polish(self.after[visit])
            self._polish(visit)

    def _insert(self, visit: int) -> None:
        """Insert a visit where it costs least, beside one of its neighbours on the ring."""
        least, place, row = BIG, -1, -1
        for rank in range(self.breadth):
            for side in range(2):
                a = self.near[visit, rank]
                if self.after[a] < 0:
                    break
                if side:
                    a = self.before[a]
                left, right = self.pose[a], self.pose[self.after[a]]
                cut = self.poses.travel(left, right)
                factor = 1.0 + NOISE * self.stream.random()
                limit = self._choose(visit, left, right, cut + least / factor)
                if self.chosen >= 0 and (limit - cut) * factor < least:
                    least, place, row = (limit - cut) * factor, a, self.chosen
        if place < 0:  # none of its neighbours is on the ring
            place = 0
            while self.after[place] < 0:
                place += 1
            self._choose(visit, self.pose[place], self.pose[self.after[place]], BIG)
            row = self.chosen
        b = self.after[place]
        self.after[place], self.after[visit], self.before[b], self.before[visit] = (
            visit,
            b,
            visit,
            place,
        )
        self.pose[visit] = row

    def _choose(self, visit: int, left: int, right: int, limit: float) -> float:
        """The least time over a visit between two rows, below `limit`; `chosen` is its row, or
        -1 if none.
        """
        self.chosen = -1
        for row in range(self.poses.offset[visit], self.poses.offset[visit + 1]):
            time = self.poses.travel(left, row)
            if time < limit:
                time += self.poses.travel(row, right)
                if time < limit:
                    limit, self.chosen = time, row
        return limit

    def _polish(self, visit: int) -> None:
        """Take the best pose of a visit; its neighbours keep theirs."""
        left, right = self.pose[self.before[visit]], self.pose[self.after[visit]]
        now = self.poses.travel(left, self.pose[visit]) + self.poses.travel(self.pose[visit], right)
        self._choose(visit, left, right, now - 1e-12)
        if self.chosen >= 0:
            self.pose[visit] = self.chosen
