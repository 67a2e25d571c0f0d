"""Where a page is in a run: at its end, at a record, or on the way through it at some speed, forwards or backwards."""

from dataclasses import dataclass

from cellwright.engine.faces.monitor.following import Follower

SPEEDS = (-1000, -100, -10, -1, 1, 10, 100, 1000)


@dataclass
class Player:
    """`number` is the record that is shown, `clock_ms` the time on the run's clock. `live`, it stays at the end; at a `speed` of
    0 it stands.
    """

    follower: Follower
    live: bool = True
    speed: float = 0.0
    number: int = 0
    clock_ms: float = 0.0
    _looked_s: float | None = None
    _came_s: float = 0.0

    def tick(self, now_s: float, goes_on: bool = True) -> None:
        """Go on. `now_s` is a clock that never goes back."""
        passed_s = now_s - (self._looked_s if self._looked_s is not None else now_s)
        self._looked_s = now_s
        if self.live:
            self._at_the_end(now_s, goes_on)
        elif self.speed:
            self._moved(1000 * passed_s * self.speed)

    def _at_the_end(self, now_s: float, goes_on: bool) -> None:
        count = len(self.follower.records)
        if count != self.number or not self._came_s:
            self.number, self._came_s = count, now_s
        factor = float(self.follower.about.get("factor", 0) or 0)
        since = 1000 * (now_s - self._came_s) / factor if factor and goes_on else 0.0
        self.clock_ms = self.last_ms + since

    @property
    def last_ms(self) -> int:
        """The time of the last record."""
        return self.follower.records[-1].at_ms if self.follower.records else 0

    def _moved(self, by_ms: float) -> None:
        wanted = self.clock_ms + by_ms
        self.clock_ms = min(max(0.0, wanted), float(self.last_ms))
        self.number = self.follower.number_at(self.clock_ms)
        if wanted != self.clock_ms:
            self.speed = 0.0

    def go_to(self, number: int) -> None:
        """Go to a record, and stand there."""
        self.live, self.speed = False, 0.0
        self.number = max(0, min(number, len(self.follower.records)))
        self.clock_ms = float(self.follower.records[self.number - 1].at_ms) if self.number else 0.0

    def to_the_end(self) -> None:
        """Show the end, and whatever comes."""
        self.live, self.speed = True, 0.0

    def play(self, speed: float) -> None:
        """Go through the run from here; from its other end, if this is the end."""
        at_end = self.clock_ms >= self.last_ms if speed > 0 else self.clock_ms <= 0
        if self.live or at_end:
            self.go_to(0 if speed > 0 else len(self.follower.records))
        self.speed = speed

    def to_exception(self) -> bool:
        """Go to the next exception behind the record that is shown, or to the first one; whether there is one."""
        numbers = self.follower.exceptions()
        if numbers:
            self.go_to(next((each for each in numbers if each > self.number), numbers[0]))
        return bool(numbers)
