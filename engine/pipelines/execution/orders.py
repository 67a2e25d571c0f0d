"""What a person or another program tells a run while it goes on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from cellwright.engine.model.execution import Order


@dataclass(frozen=True, slots=True)
class Given:
    """An order, what it says besides (a step, facts, a command, an answer), and where it came from.

    `who` gave it and `when` (date and time, UTC) are noted in the journal if they are known.
    """

    order: Order
    text: str = ""
    origin: str = "terminal"
    who: str = ""
    when: str = ""

    def content(self) -> dict[str, str]:
        """The order as a record has it."""
        said = {"order": self.order.value, "given": self.text, "origin": self.origin}
        return said | {key: value for key, value in (("who", self.who), ("when", self.when)) if value}


class Orders(Protocol):
    """Where orders come from."""

    def due(self, now_ms: int) -> Sequence[Given]:
        """The orders that came since the last call."""
        ...

    def next_ms(self) -> int | None:
        """When the next order will come, if that is known."""
        ...

    def wait(self) -> bool:
        """Wait for an order, a while; False if none can ever come."""
        ...


class Timed:
    """Orders that are given at times of the run's clock, as a test or an experiment gives them."""

    def __init__(self, orders: Iterable[tuple[int, Given]] = ()) -> None:
        self._orders = sorted(orders, key=lambda each: each[0])

    def due(self, now_ms: int) -> Sequence[Given]:
        """The orders until now."""
        found = [given for when, given in self._orders if when <= now_ms]
        self._orders = [each for each in self._orders if each[0] > now_ms]
        return found

    def next_ms(self) -> int | None:
        """The time of the next order."""
        return self._orders[0][0] if self._orders else None

    def wait(self) -> bool:
        """Whether an order is still to come. Each comes at its own time, also at a pause: time goes on there, too."""
        return bool(self._orders)
