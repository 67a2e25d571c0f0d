"""The cell once more, as plain Python: what its devices allow, written from the paper and not
from the domain files.
"""

import re
from dataclasses import dataclass, field

from cellwright.kb.model.plan_model import Plan


class Unsafe(AssertionError):
    """The cell would be damaged, or a step does nothing sensible."""


@dataclass
class Cell:
    """The state of one THEMSE: where everything is, and what was done to each probe."""

    where: dict[str, str] = field(
        default_factory=lambda: (
            {f"probe_{n}": f"slot(drawer, {n})" for n in range(1, 5)} | {"lid": "rim"}
        )
    )
    drawer: str = "closed"
    flap: str = "closed"
    bayonet: str = "locked"
    history: dict[str, list[tuple[str, int]]] = field(default_factory=dict)

    def execute(self, plan: Plan) -> "Cell":
        """Do the steps of a plan one after another. Raises `Unsafe`."""
        for step in plan.steps:
            name, *arguments = re.findall(r"slot\(\w+, \d+\)|\w+", str(step.operator))
            getattr(self, name)(*arguments)
        return self

    def _need(self, holds: bool, what: str) -> None:
        if not holds:
            raise Unsafe(what)

    def _hand_is_empty(self) -> None:
        self._need("mars_gripper" not in self.where.values(), "the hand is full")

    def open_drawer(self) -> None:
        self._hand_is_empty()
        self._need(self.drawer == "closed", "the drawer is open")
        self.drawer = "open"

    def close_drawer(self) -> None:
        self._hand_is_empty()
        self._need(self.drawer == "open", "the drawer is closed")
        self.drawer = "closed"

    def press_switch(self, before: str, after: str) -> None:
        self._hand_is_empty()
        self._need(self.flap == before != after, "the flap is elsewhere")
        self.flap = after

    def turn_bayonet(self, before: str, after: str) -> None:
        self._hand_is_empty()
        self._need(self.where["lid"] == "rim", "no lid to turn")
        self._need(self.bayonet == before != after, "the bayonet is elsewhere")
        self.bayonet = after

    def _reach(self, place: str) -> None:
        if place.startswith("slot(drawer"):
            self._need(self.drawer == "open", "the drawer is closed")
        elif place.startswith("slot(furnace"):
            self._need(self.flap == "open", "the furnace is touched with its flap closed")
        elif place.startswith("slot(freezer"):
            self._need(self.where["lid"] == "stand", "the lid is in the way")
        elif place == "rim":
            self._need(self.bayonet == "unlocked", "the lid is locked")

    def pick(self, item: str, place: str) -> None:
        self._hand_is_empty()
        self._reach(place)
        self._need(self.where[item] == place, f"{item} is not there")
        self.where[item] = "mars_gripper"

    def put(self, item: str, place: str) -> None:
        self._reach(place)
        self._need(self.where[item] == "mars_gripper", f"{item} is not in the hand")
        self._need(place not in self.where.values(), f"{place} is taken")
        self._need((item == "lid") == (place in ("rim", "stand")), f"{item} does not fit {place}")
        self.where[item] = place

    def heat(self, probe: str, place: str, seconds: str) -> None:
        self._need(
            self.where[probe] == place and place.startswith("slot(furnace"), "not in the furnace"
        )
        self._need(self.flap == "closed", "heating with the flap open")
        self.history.setdefault(probe, []).append(("heated", int(seconds)))

    def cool(self, probe: str, place: str, seconds: str) -> None:
        self._need(
            self.where[probe] == place and place.startswith("slot(freezer"), "not in the freezer"
        )
        self._need(
            self.where["lid"] == "rim" and self.bayonet == "locked", "cooling with the lid loose"
        )
        self.history.setdefault(probe, []).append(("cooled", int(seconds)))

    def sense(self, sensor: str) -> None:
        """Reading a sensor changes nothing."""
