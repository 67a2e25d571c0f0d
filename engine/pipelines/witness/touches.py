"""What touches while steps are played, and which of it no step allows."""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from cellwright.engine.model.moves import Leg
from cellwright.engine.pipelines.witness.tree import worn_by
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Operation

LEAST_N = 1.0  # a contact with less force is a graze of rounding


@dataclass(frozen=True, slots=True)
class Touched:
    """A contact that no step allows: when, in which step, between what, and how strong at most."""

    at_s: float
    step: int
    first: str
    second: str
    force_n: float


class Stopped(Exception):
    """An arm has met a body that it is guarded against, on a leg, so long after its start."""

    def __init__(self, body: str, leg: Leg, at_s: float) -> None:
        super().__init__(f"{leg.arm} has met {body}")
        self.body, self.leg, self.at_s = body, leg, at_s


class Touches:
    """The contacts of one play that no step allows: of each pair in each step the strongest."""

    def __init__(self, model: "mujoco.MjModel", data: "mujoco.MjData", world: World) -> None:
        self._model, self._data, self._world = model, data, world
        self._strongest: dict[tuple[int, str, str], Touched] = {}

    @property
    def found(self) -> tuple[Touched, ...]:
        """All of them, in the order in which they were first seen."""
        return tuple(self._strongest.values())

    def look(self, step: int, held: Collection[str], allowed: Collection[str]) -> None:
        """Note every contact of the arm, its hand, and what is `held`, that the step does not allow."""
        force = np.zeros(6)
        for number in range(self._data.ncon):
            contact = self._data.contact[number]
            names = tuple(sorted(body_of(self._model, geom) for geom in contact.geom))
            if contact.dist >= 0 or not self._is_strange(names, held, allowed):
                continue
            mujoco.mj_contactForce(self._model, self._data, number, force)
            key = (step, names[0], names[1])
            known = self._strongest.get(key)
            if abs(force[0]) >= LEAST_N and (known is None or force[0] > known.force_n):
                self._strongest[key] = Touched(round(self._data.time, 3), *key, round(float(force[0]), 2))

    def met(self, guard: Collection[str], along: Collection[str]) -> str:
        """The first of some bodies that an arm, its hand, or what goes along with it touches now; empty if none."""
        for number in range(self._data.ncon):
            contact = self._data.contact[number]
            names = [body_of(self._model, geom) for geom in contact.geom]
            for one, other in (names, names[::-1]):
                if one in guard and (other in along or self._arm_of(other)) and contact.dist < 0:
                    return one
        return ""

    def _is_strange(self, names: tuple[str, ...], held: Collection[str], allowed: Collection[str]) -> bool:
        """Whether one of two bodies is an arm's, and the other neither its own nor one that the step allows."""
        arms = {self._arm_of(name) for name in names} - {""}
        if len(arms) > 1:
            return True
        own = [name in held or bool(self._arm_of(name)) for name in names]
        if all(own) or not any(own):
            return False
        return names[0 if own[1] else 1] not in allowed

    def _arm_of(self, name: str) -> str:
        """The arm that a body is a part of, or is mounted on; empty if there is none."""
        arms = self._world.cell.arms
        arm = name.partition("/")[0].partition(".")[0]
        if arm in arms:
            return arm
        return next((each for each in arms if name in worn_by(self._world, each)), "")


def body_of(model: "mujoco.MjModel", geom: int) -> str:
    """The body that a shape of a model belongs to."""
    return str(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.geom_bodyid[geom]))


def allowed_in(place: str, operation: Operation, before: World) -> frozenset[str]:
    """What may be touched at the places of a step: what they name, what they stand on, and what is dragged."""
    found = {operation.drags}
    places = before.cell.places
    for known in (places[name] for name in (place, str(operation.with_place)) if name in places):
        found |= {*known.touches, *before.supports(known.placement.parent)}
    return frozenset(found)
