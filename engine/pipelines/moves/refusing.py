"""Why a step has no motion: at which level it fails, with a sentence for people and the bodies that are in the way."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.model.motion import Blocked
from cellwright.engine.model.moves import Unmoved
from cellwright.engine.pipelines.moves.hands import held
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.stages.geometry.reach.reach import Unreached
from cellwright.engine.stages.geometry.reach.seeing import Unseen
from cellwright.kb.model.cell import Cell, Place
from cellwright.kb.model.plan import Step


@dataclass(frozen=True, slots=True, eq=False)
class Refusal:
    """One step at a place, from one state to another."""

    step: Step
    place: Place
    cell: Cell
    before: Room
    after: Room

    def unreached(self, poses: Floats) -> Unmoved:
        """No configuration at the place is free, or there is none."""
        answer = self.before.reach.at(self.place)
        reason = answer.reason if isinstance(answer, Unreached) else "no configuration is free"
        if not len(poses):
            return self._unmoved("reach", reason, sure=True)
        culprits = {name for q in poses for name in self._others(q, self.before)}
        return self._unmoved("contact", reason, tuple(sorted(culprits)), sure=True)

    def no_straight(self, paths: Sequence[Floats | None], sure: bool) -> Unmoved:
        """The arm gets to the place in some configurations, but not straight in and out in any of them.

        `paths` (m, k) are the ways in, None where the arm cannot follow. It is sure if something touches on each of the others.
        """
        culprits = set[str]()
        for path in paths:
            touched = set(self._touched_along(path)) if path is not None else set()
            sure = sure and (path is None or bool(touched))
            culprits |= touched
        past = f" past {', '.join(sorted(culprits))}" if culprits else ""
        reason = f"there is no straight way in and out{past}"
        return self._unmoved("approach", reason, tuple(sorted(culprits)), sure)

    def unseen(self, why: Unseen, sure: bool) -> Unmoved:
        """The tool does not see what it is to measure."""
        return self._unmoved("sight", why.reason, why.culprits, sure)

    def _touched_along(self, path: Floats) -> Iterator[str]:
        """What is touched first on a straight way into the place, or on the way out of it."""
        for room in (self.before, self.after):
            hits = room.collides(self.place, path)
            if hits.any():
                yield from self._others(path[int(np.argmax(hits))], room)
                return
        yield from self._strangers(
            self.before.free(self.place.arm).contacts(self.before.whole(self.place.arm, path[:1])[0])
        )

    def _others(self, q: Floats, room: Room) -> Iterator[str]:
        """The bodies that the arm, or what it holds, touches at a configuration."""
        return self._strangers(room.touching(self.place, q))

    def _strangers(self, contacts: Iterable[Contact]) -> Iterator[str]:
        """What is in contact, except for the arm and what it holds; the arm's own name where it touches itself."""
        own = {*held(self.before.world, self.place.arm), *held(self.after.world, self.place.arm)}
        for contact in contacts:
            names = [
                name
                for name in (contact.first, contact.second)
                if name not in own and not name.startswith(f"{self.place.arm}.")
            ]
            yield from names or [self.place.arm]

    def no_way(self, found: Blocked | None) -> Unmoved:
        if found is None:
            return self._unmoved("way", f"{self.place.arm} stands where something touches it")
        names = {name for each in found.contacts for name in (each.first, each.second)}
        reason = "no way leads there" + (f" past {', '.join(sorted(names))}" if names else "")
        return self._unmoved("way", reason, tuple(sorted(names)))

    def _unmoved(
        self, level: str, reason: str, culprits: tuple[str, ...] = (), sure: bool = False
    ) -> Unmoved:
        bodies = tuple(each for each in culprits if each in self.cell.bodies)
        return Unmoved(self.step.id, self.step.operator, self.place.name, level, reason, bodies, sure=sure)
