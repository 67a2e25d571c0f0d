"""A partial schedule: some stages of a shop are placed, and how its resources and devices stand after them."""

from collections.abc import Mapping
from dataclasses import dataclass

from cellwright.engine.model.schedule import Adjustment
from cellwright.engine.model.shop import Shop


@dataclass(frozen=True, slots=True)
class DeviceStanding:
    """How a device stands: its setting, since when it has it, and until when some placed stage needs it."""

    setting: str
    since: int = 0
    until: int = 0


@dataclass(frozen=True, slots=True)
class Partial:
    """A schedule of some stages. `units` are the times from which each unit of a resource is free again."""

    starts: Mapping[str, int]
    units: Mapping[str, tuple[int, ...]]
    places: Mapping[str, str]
    devices: Mapping[str, DeviceStanding]
    adjustments: tuple[Adjustment, ...] = ()
    estimate: int = 0
    tardiness: int = 0

    @property
    def score(self) -> tuple[int, int, int]:
        """A sort key: the smaller, the better."""
        return self.tardiness, self.estimate, sum(self.starts.values())

    def travel(self, shop: Shop, resource: str, origin: str) -> int:
        """How long a resource takes from where it is to where it is needed."""
        if resource not in self.places:
            return 0
        return shop.resource[resource].travel.get((self.places[resource], origin), 0)
