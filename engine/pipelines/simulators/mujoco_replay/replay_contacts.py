"""Contacts while steps are played in MuJoCo, and those that no step allows."""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from cellwright.engine.model.motion_values import StepLeg
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import worn_by
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.cell_model import Operation

LEAST_N = 1.0  # a contact with less force is a graze of rounding


@dataclass(frozen=True, slots=True)
class ForbiddenContact:
    """A contact that no step allows: when, in which step, between what, and how strong at most."""

    at_s: float
    step: int
    first: str
    second: str
    force_n: float


class ArmStopped(Exception):
    """An arm has met a body that it is guarded against, on a leg, so long after its start."""

    def __init__(self, body: str, leg: StepLeg, at_s: float) -> None:
        super().__init__(f"{leg.arm} has met {body}")
        self.body, self.leg, self.at_s = body, leg, at_s


class ContactRecord:
    """The contacts of one play that no step allows: of each pair in each step the strongest."""

    def __init__(
        self, model: "mujoco.MjModel", data: "mujoco.MjData", world: GeometricWorld
    ) -> None:
        self._model, self._data, self._world = model, data, world
        self._strongest: dict[tuple[int, str, str], ForbiddenContact] = {}

    @property
    def found(self) -> tuple[ForbiddenContact, ...]:
        """All of them, in the order in which they were first seen."""
        return tuple(self._strongest.values())

    def look(self, step: int, held: Collection[str], allowed: Collection[str]) -> None:
        """Note every contact of the arm, its hand, and what is `held`, that the step does not
        allow.
        """
        force = np.zeros(6)
        for number in range(self._data.ncon):
            contact = self._data.contact[number]
            names = tuple(sorted(body_of(self._model, geom) for geom in contact.geom))
            if contact.dist >= 0 or not self._is_strange(names, held, allowed):
                continue
            mujoco.mj_contactForce(self._model, self._data, number, force)
            key = (step, names[0], names[1])
            strongest = self._strongest.get(key)
            if abs(force[0]) >= LEAST_N and (strongest is None or force[0] > strongest.force_n):
                self._strongest[key] = ForbiddenContact(
                    round(self._data.time, 3), *key, round(float(force[0]), 2)
                )

    def met(self, guard: Collection[str], along: Collection[str]) -> str:
        """The first of some bodies that an arm, its hand, or what goes along with it touches
        now; empty if none.
        """
        for number in range(self._data.ncon):
            contact = self._data.contact[number]
            names = [body_of(self._model, geom) for geom in contact.geom]
            for first, second in (names, names[::-1]):
                if (
                    first in guard
                    and (second in along or self._arm_of(second))
                    and contact.dist < 0
                ):
                    return first
        return ""

    def _is_strange(
        self, names: tuple[str, ...], held: Collection[str], allowed: Collection[str]
    ) -> bool:
        """Whether one of two bodies is an arm's, and the other neither its own nor one that the
        step allows.
        """
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
        return next((arm for arm in arms if name in worn_by(self._world, arm)), "")


def body_of(model: "mujoco.MjModel", geom: int) -> str:
    """The body that a shape of a model belongs to."""
    return str(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, model.geom_bodyid[geom]))


def allowed_in(place: str, operation: Operation, before: GeometricWorld) -> frozenset[str]:
    """What may be touched at the places of a step: what they name, what they stand on, and what
    is dragged.
    """
    allowed = {operation.drags}
    places = before.cell.places
    for cell_place in (
        places[name] for name in (place, str(operation.with_place)) if name in places
    ):
        allowed |= {*cell_place.touches, *before.supports(cell_place.placement.parent)}
    return frozenset(allowed)
