"""Orders that a person or another program gives to a run, and where they come from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from cellwright.engine.model.run_protocol import OperatorCommand


@dataclass(frozen=True, slots=True)
class GivenOrder:
    """An order, what it says besides (a step, facts, a command, an answer), and where it came from.

    `who` gave it and `when` (date and time, UTC) are noted in the journal if they are known.
    """

    order: OperatorCommand
    text: str = ""
    origin: str = "terminal"
    who: str = ""
    when: str = ""

    def content(self) -> dict[str, str]:
        """The order as a record has it."""
        entry = {"order": self.order.value, "given": self.text, "origin": self.origin}
        return entry | {
            key: value for key, value in (("who", self.who), ("when", self.when)) if value
        }


class OrderSource(Protocol):
    """Where orders come from."""

    def due(self, now_ms: int) -> Sequence[GivenOrder]:
        """The orders that came since the last call."""
        ...

    def next_ms(self) -> int | None:
        """When the next order will come, if that is known."""
        ...

    def wait(self) -> bool:
        """Wait for an order, a while; False if none can ever come."""
        ...


class TimedOrders:
    """Orders that are given at times of the run's clock, as a test or an experiment gives them."""

    def __init__(self, orders: Iterable[tuple[int, GivenOrder]] = ()) -> None:
        self._orders = sorted(orders, key=lambda timed_order: timed_order[0])

    def due(self, now_ms: int) -> Sequence[GivenOrder]:
        """The orders until now."""
        due_orders = [order for when, order in self._orders if when <= now_ms]
        self._orders = [order for order in self._orders if order[0] > now_ms]
        return due_orders

    def next_ms(self) -> int | None:
        """The time of the next order."""
        return self._orders[0][0] if self._orders else None

    def wait(self) -> bool:
        """Whether an order is still to come.

        Each comes at its own time, also at a pause: time goes on there, too.
        """
        return bool(self._orders)
