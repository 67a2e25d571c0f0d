# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Use of resources over time: how much of each is in use at each time, and the earliest starts at
which a sequence of acts fits in.

Plain Python, compiled with the types in `taken.pxd`. What a resource has is a row of times, in
order, with how much is taken from each time on. All that is asked of a row of acts can only be
mended by starting later: an act begins when the one before it has ended, what it uses is free, what
it holds until a later act is free as long, what may be held only so long is taken later, and an act
that waits for another starts so long after it. So there are least starts, and raising starts until
nothing is amiss finds them.
"""

from array import array
from collections.abc import Sequence

FOREVER = 1 << 40  # later than any time
ROOM = 16  # times of a resource for which there is room at first
ROUNDS = 100_000  # in which starts are raised
FREE = -1  # nothing clashes


class Row:
    """Acts one after another: durations, uses as (act, resource, begin, end), holds as
    (resource, first act, begin, came, last act, left, end, most), and waits as (act, other act,
    time): the act starts so long after the other one at the earliest.

    Times of uses and holds count from the start of their acts. A resource that is not shared is -1.
    A hold without a first act has -1 there, as has one without a last act, and one that may last
    for ever in place of `most`. In place of an act that is waited for, or that waits, -1 is time 0.
    """

    def __init__(
        self,
        durations: Sequence[int],
        uses: Sequence[tuple[int, int, int, int]],
        holds: Sequence[tuple[int, ...]],
        whole: bool,
        waits: Sequence[tuple[int, int, int]] = (),
    ) -> None:
        self.count, self.whole = len(durations), whole
        self.durations = array("q", [*durations, 0])
        self.used, self.held, self.waiting = len(uses), len(holds), len(waits)
        self.waits = array("q", [value for wait in waits for value in wait] or [0])
        self.uses = array("q", [value for use in uses for value in use] or [0])
        self.holds = array("q", [value for hold in holds for value in hold] or [0])
        named = [*(use[1] for use in uses), *(hold[0] for hold in holds)]
        self.resources = 1 + max(named, default=-1)
        acts = [*(use[0] for use in uses), *(each for hold in holds for each in (hold[1], hold[4]))]
        acts += [act for wait in waits for act in wait[:2]]
        if max(acts, default=0) >= max(1, self.count) or any(len(hold) != 8 for hold in holds):
            raise ValueError("a use or a hold is of an act that is not there")


class Taken:
    """What is taken of resources with some capacities."""

    def __init__(self, capacities: Sequence[int]) -> None:
        self.count, self.room = len(capacities), ROOM
        self.capacities = array("q", [*capacities, 0])
        self.times = array("q", ([-FOREVER] + [0] * (ROOM - 1)) * (self.count + 1))
        self.counts = array("q", bytes(8 * ROOM * (self.count + 1)))
        self.sizes = array("q", [1] * (self.count + 1))

    def add(self, resource: int, begin: int, end: int, change: int) -> None:
        """Take so many units from `begin` to `end`, or give them back.

        Raises `ValueError` for a resource that is not there.
        """
        if not 0 <= resource < self.count:
            raise ValueError("there is no such resource")
        if begin >= end:
            return
        if self.sizes[resource] + 2 > self.room:
            self._widen()
        first = self._cut(resource, begin)
        last = self._cut(resource, end)
        row = resource * self.room
        for place in range(row + first, row + last):
            self.counts[place] += change
        self._join(resource, last)
        self._join(resource, first)

    def mark(self, row: Row, starts: "array[int]", change: int) -> None:
        """Take what a row of acts uses and holds, or give it back; what it never gives back is
        taken for ever.
        """
        if len(starts) < row.count or row.resources > self.count:
            raise ValueError("each act needs a start, and each resource must be there")
        uses, holds = row.uses, row.holds
        for use in range(0, 4 * row.used, 4):
            start = starts[uses[use]]
            self.add(uses[use + 1], start + uses[use + 2], start + uses[use + 3], change)
        for hold in range(0, 8 * row.held, 8):
            if holds[hold] < 0:
                continue
            start = 0
            if holds[hold + 1] >= 0:
                start = starts[holds[hold + 1]] + holds[hold + 2]
            end = FOREVER
            if holds[hold + 4] >= 0:
                end = starts[holds[hold + 4]] + holds[hold + 6]
            self.add(holds[hold], start, end, change)

    def _widen(self) -> None:
        """Make room for twice as many times."""
        wide = 2 * self.room
        times, counts = (
            array("q", bytes(8 * wide * (self.count + 1))),
            array("q", bytes(8 * wide * (self.count + 1))),
        )
        for resource in range(self.count):
            for place in range(self.sizes[resource]):
                times[resource * wide + place] = self.times[resource * self.room + place]
                counts[resource * wide + place] = self.counts[resource * self.room + place]
        self.times, self.counts, self.room = times, counts, wide

    def _first_from(self, resource: int, time: int) -> int:
        """The first place whose time is not before `time`."""
        low, high, row = 0, self.sizes[resource], resource * self.room
        while low < high:
            middle = (low + high) // 2
            if self.times[row + middle] < time:
                low = middle + 1
            else:
                high = middle
        return low

    def _cut(self, resource: int, time: int) -> int:
        """The place of a time, which is put in if it is not there."""
        size, row = self.sizes[resource], resource * self.room
        place = self._first_from(resource, time)
        if place < size and self.times[row + place] == time:
            return place
        for other in range(size, place, -1):
            self.times[row + other] = self.times[row + other - 1]
            self.counts[row + other] = self.counts[row + other - 1]
        self.times[row + place] = time
        self.counts[row + place] = self.counts[row + place - 1]
        self.sizes[resource] = size + 1
        return place

    def _join(self, resource: int, place: int) -> None:
        """Take a time out after which as much is taken as before it."""
        row = resource * self.room
        if place == 0 or self.counts[row + place] != self.counts[row + place - 1]:
            return
        size = self.sizes[resource]
        for other in range(row + place, row + size - 1):
            self.times[other] = self.times[other + 1]
            self.counts[other] = self.counts[other + 1]
        self.sizes[resource] = size - 1

    def clash(self, resource: int, begin: int, end: int) -> int:
        """The end of the last time between `begin` and `end` at which all is taken; -1 if there
        is no such time.
        """
        if begin >= end or not 0 <= resource < self.count:
            return FREE
        size, most, row = self.sizes[resource], self.capacities[resource], resource * self.room
        place = self._first_from(resource, end) - 1
        while place >= 0:
            if self.counts[row + place] >= most:
                place += 1
                while place < size and self.counts[row + place] >= most:
                    place += 1
                return self.times[row + place] if place < size else FOREVER
            if self.times[row + place] <= begin:
                return FREE
            place -= 1
        return FREE

    def raised(self, row: Row, starts: "array[int]") -> bool:
        """Raise starts until a row of acts fits; whether it fits at all.

        Raises `ValueError` if there are too few starts.
        """
        if len(starts) < row.count or row.resources > self.count or row.count < 1:
            raise ValueError("each act needs a start, and each resource must be there")
        last = row.count - 1
        for _ in range(ROUNDS):
            changed = self._by_acts(row, starts)
            end = FOREVER if row.whole else starts[last] + row.durations[last]
            if self._by_holds(row, starts, end):
                changed = True
            waited = self._by_waits(row, starts)
            if waited < 0:
                return False
            if waited > 0:
                changed = True
            if not changed:
                return True
            if starts[last] >= FOREVER:
                return False
        return False

    def _by_acts(self, row: Row, starts: "array[int]") -> bool:
        """Raise starts for what comes before and what is used."""
        changed, now, use = False, 0, 0
        uses = row.uses
        for act in range(row.count):
            start = starts[act]
            if now > start:
                start = now
            first = use
            while use < row.used and uses[4 * use] == act:
                until = self.clash(
                    uses[4 * use + 1], start + uses[4 * use + 2], start + uses[4 * use + 3]
                )
                if until >= 0:
                    start = until - uses[4 * use + 2]
                    use = first
                else:
                    use += 1
            if start > starts[act]:
                starts[act] = start
                changed = True
            now = start + row.durations[act]
        return changed

    def _by_holds(self, row: Row, starts: "array[int]", end: int) -> bool:
        """Raise starts for what is held; what is not given back is held until `end`."""
        changed = False
        holds = row.holds
        for hold in range(0, 8 * row.held, 8):
            first, last = holds[hold + 1], holds[hold + 4]
            if first < 0:
                continue
            least = starts[first]
            if holds[hold] >= 0:
                until = self.clash(
                    holds[hold],
                    least + holds[hold + 2],
                    end if last < 0 else starts[last] + holds[hold + 6],
                )
                if until >= 0:
                    least = until - holds[hold + 2]
            if last >= 0 and holds[hold + 7] >= 0:
                latest = starts[last] + holds[hold + 5] - holds[hold + 3] - holds[hold + 7]
                if latest > least:
                    least = latest
            if least > starts[first]:
                starts[first] = least
                changed = True
        return changed

    def _by_waits(self, row: Row, starts: "array[int]") -> int:
        """Raise starts for acts that wait for others; whether any was raised, and -1 if time 0
        would have to be.
        """
        changed = 0
        waits = row.waits
        for wait in range(0, 3 * row.waiting, 3):
            act, other = waits[wait], waits[wait + 1]
            least = waits[wait + 2]
            if other >= 0:
                least += starts[other]
            if act < 0:
                if least > 0:
                    return -1
            elif least > starts[act]:
                starts[act] = least
                changed = 1
        return changed
