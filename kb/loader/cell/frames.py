"""The frames of a cell by name: what each is placed in. None may be placed in itself."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.quantities import Quantities, child
from cellwright.kb.loader.reader import Findings
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import WORLD, Body, MountedArm, Placement


def read_placement(node: Node, read: Quantities) -> Placement:
    """The pose of an entry, and the frame that it is given in, which need not be known."""
    parent = child(node, "in")
    where = parent.where if parent else node.where
    return Placement(parent.value if parent else WORLD, read.pose(node), where)


@dataclass
class Frames:
    """The frames that were found so far. Wrong references to them are added to `findings`."""

    findings: Findings
    placements: dict[str, Placement] = field(default_factory=dict)

    def names(self) -> Collection[str]:
        """All that something may be placed in."""
        return [WORLD, *self.placements]

    def is_known(self, placement: Placement) -> bool:
        """Whether something is placed in a known frame; an unknown one is reported."""
        known = placement.parent == WORLD or placement.parent in self.placements
        if not known:
            where = placement.where
            self.findings.note(unknown_name("frame", placement.parent, self.names(), where))
        return known

    def add(
        self, arms: Mapping[str, MountedArm], frames: Mapping[str, Placement], bodies: Mapping[str, Body]
    ) -> None:
        """Collect every frame by name, then check that each is placed in a known frame and none in itself."""
        self.placements |= dict(_of_arms(arms))
        self.placements |= frames
        for name, body in bodies.items():
            self.placements[name] = body.placement
            self.placements |= {f"{name}.{feature}": Placement(name) for feature in body.features}
        for name, placement in self.placements.items():
            if self.is_known(placement) and self._is_circular(name):
                hint = "follow `in` from frame to frame: it must end at `world`"
                self.findings.add(placement.where, "K701", f"'{name}' is placed relative to itself", hint)

    def _is_circular(self, name: str) -> bool:
        seen, at = set[str](), name
        while at in self.placements and at not in seen:
            seen.add(at)
            at = self.placements[at].parent
        return at == name


def _of_arms(arms: Mapping[str, MountedArm]) -> Iterator[tuple[str, Placement]]:
    for name, arm in arms.items():
        for frame in ("flange", "tool", *(link.name for link in arm.arm.links)):
            yield f"{name}.{frame}", Placement(f"{name}.base")
        yield f"{name}.base", arm.base  # a link of this name may be elsewhere
