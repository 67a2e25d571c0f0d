"""The geometric world: where every frame is, what is affixed to what, also by symbolic facts.

It is a value: every change makes a new world. Frames have their names from `cell.yaml`: `world`, a
frame, a body, `body.feature`; for an arm, `arm.base`, `arm.flange`, `arm.tool`, and `arm.LINK` for
each link.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel, carrier_poses
from cellwright.kb.model.cell_model import Cell, JointKind, Link, Location, Placement
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.terms import Atom, Substitution, Variable, match_term, substitute_term

NO_JOINTS = Joints(
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 4, 4)),
    np.zeros((0, 3)),
    np.zeros(0, dtype=bool),
    np.zeros(0),
    np.zeros(0),
)


@dataclass(frozen=True, slots=True, eq=False)
class LocatedFrame:
    """A frame fixed to a carrier: T_carrier_frame (4, 4)."""

    carrier: int
    T_carrier_frame: Floats


@dataclass(frozen=True, slots=True, eq=False)
class FixedFrame:
    """A frame fixed to another frame: T_parent_frame (4, 4)."""

    parent: str
    T_parent_frame: Floats


@dataclass(frozen=True, eq=False)
class GeometricWorld:
    """A cell at one moment: `placed` says where frames and bodies are, `configurations` holds the
    joint values of each arm.
    """

    cell: Cell
    placed: Mapping[str, FixedFrame]
    configurations: Mapping[str, Floats]

    @classmethod
    def of(cls, cell: Cell) -> "GeometricWorld":
        """The cell as its file describes it, with every arm at its `home` (at zero if none is
        given).
        """
        placements: dict[str, Placement] = {
            f"{name}.base": arm.base for name, arm in cell.arms.items()
        }
        placements |= cell.frames
        placements |= {name: body.placement for name, body in cell.bodies.items()}
        fixed = {
            name: FixedFrame(placement.parent, transforms.of_pose(placement.pose))
            for name, placement in placements.items()
        }
        for name, body in cell.bodies.items():
            for feature, pose in body.features.items():
                fixed[f"{name}.{feature}"] = FixedFrame(name, transforms.of_pose(pose))
        homes = {
            name: np.array(arm.home or (0.0,) * len(arm.arm.joints))
            for name, arm in cell.arms.items()
        }
        return cls(cell, fixed, homes)

    @cached_property
    def models(self) -> dict[str, ArmModel]:
        """The arms, ready for computing."""
        return {name: ArmModel(mounted.arm) for name, mounted in self.cell.arms.items()}

    @cached_property
    def first_carriers(self) -> dict[str, int]:
        """For each arm, the number of carriers before its own carriers."""
        firsts, count = {}, 0
        for name, mounted in self.cell.arms.items():
            firsts[name] = count
            count += len(mounted.arm.joints)
        return firsts

    def locate(self, frame: str) -> LocatedFrame:
        """The carrier that a frame is fixed to, and the pose of the frame in it.

        Raises `KeyError` for an unknown frame.
        """
        if frame == WORLD_FRAME:
            return LocatedFrame(0, np.eye(4))
        if frame in self.placed:
            fixed = self.placed[frame]
            below = self.locate(fixed.parent)
            return LocatedFrame(below.carrier, matmul(below.T_carrier_frame, fixed.T_parent_frame))
        arm, _, part = frame.partition(".")
        if arm not in self.cell.arms:
            raise KeyError(f"no frame '{frame}'")
        return self._locate_part(arm, part)

    def _locate_part(self, arm: str, part: str) -> LocatedFrame:
        mounted, model = self.cell.arms[arm], self.models[arm]
        last = len(mounted.arm.joints)
        if part in ("flange", "tool"):
            T = model.T_last_flange
            T = matmul(T, transforms.of_pose(mounted.tool)) if part == "tool" else T
            return self._on_arm(arm, last, T)
        for link in mounted.arm.links:
            if link.name == part:
                return self.locate_link(arm, link)
        raise KeyError(f"no frame '{arm}.{part}'")

    def locate_link(self, arm: str, link: Link) -> LocatedFrame:
        """The carrier of a link, and the pose of the link in it.

        A link may have any name, even `base`, `flange` or `tool`, which name frames elsewhere.
        """
        return self._on_arm(arm, link.carrier, transforms.of_offsets(link.offset))

    def _on_arm(self, arm: str, carrier: int, T: Floats) -> LocatedFrame:
        if carrier == 0:
            base = self.locate(f"{arm}.base")
            return LocatedFrame(base.carrier, matmul(base.T_carrier_frame, T))
        return LocatedFrame(self.first_carriers[arm] + carrier, T)

    @cached_property
    def joints(self) -> Joints:
        """All joints of all arms as one forest, in the order of the cell's arms."""
        parts = [self._arm_joints(name) for name in self.cell.arms]
        if not parts:
            return NO_JOINTS
        return Joints(
            np.concatenate([part.parent for part in parts]),
            np.concatenate([part.T_parent_origin for part in parts]),
            np.concatenate([part.axis for part in parts]),
            np.concatenate([part.prismatic for part in parts]),
            np.concatenate([part.lower for part in parts]),
            np.concatenate([part.upper for part in parts]),
        )

    def _arm_joints(self, name: str) -> Joints:
        """An arm's joints. The first joint stands on the carrier of the arm's base."""
        own, base = self.models[name].joints, self.locate(f"{name}.base")
        parent, origins = own.parent + self.first_carriers[name], own.T_parent_origin.copy()
        if own.count:
            parent[0], origins[0] = base.carrier, matmul(base.T_carrier_frame, origins[0])
        return replace(own, parent=parent, T_parent_origin=origins)

    @cached_property
    def configuration(self) -> Floats:
        """The values of all joints (k,), in the order of `joints`."""
        return np.concatenate(
            [np.zeros(0), *(self.configurations[name] for name in self.cell.arms)]
        )

    @cached_property
    def _carriers(self) -> Floats:
        return carrier_poses(self.joints, self.configuration)

    def pose(self, a: str, b: str) -> Floats:
        """T_a_b (4, 4): the pose of frame b in frame a. Raises `KeyError` for an unknown frame."""
        in_world = [
            matmul(self._carriers[at.carrier], at.T_carrier_frame)
            for at in (self.locate(a), self.locate(b))
        ]
        pose: Floats = matmul(transforms.inverse(in_world[0]), in_world[1])
        return pose

    def moved(self, arm: str, q: Floats) -> "GeometricWorld":
        """The world with one arm at a configuration (k,). What is affixed to the arm moves with it.

        Raises `KeyError` for an unknown arm, `ValueError` unless there is a finite number for each
        joint.
        """
        values, count = np.asarray(q, dtype=float), self.models[arm].joints.count
        if values.shape != (count,) or not np.isfinite(values).all():
            raise ValueError(f"{arm} has {count} joints, and needs a finite number for each")
        return replace(self, configurations={**self.configurations, arm: values})

    def affix(self, body: str, to: str) -> "GeometricWorld":
        """The world in which a body, wherever it is now, moves with a frame from now on.

        Raises `KeyError` for an unknown name, `ValueError` if `to` stands on the body itself.
        """
        return self.put(body, to, self.pose(to, body))

    def put(self, body: str, on: str, T_on_body: Floats) -> "GeometricWorld":
        """The world with a body at a pose (4, 4) on a frame.

        Raises as `affix` does, and `ValueError` for what is no pose.
        """
        if body not in self.cell.bodies:
            raise KeyError(f"no body '{body}'")
        self.locate(on)
        if body in self.supports(on):
            raise ValueError(f"'{on}' stands on '{body}'")
        T = np.array(T_on_body, dtype=float)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise ValueError(f"the pose of '{body}' must be (4, 4), of finite numbers")
        return replace(self, placed={**self.placed, body: FixedFrame(on, T)})

    def guided(self, body: str, value: float) -> "GeometricWorld":
        """The world with a body, and all that follow it, so far along their guides (m or rad).

        Raises `KeyError` for a body that has none.
        """
        described = self.cell.bodies.get(body)
        if described is None or described.guide is None:
            raise KeyError(f"'{body}' has no joint")
        world = self._guided(body, value)
        for name, described_body in self.cell.bodies.items():
            if described_body.guide is not None and described_body.guide.follows == body:
                world = world._guided(name, value)
        return world

    def _guided(self, body: str, value: float) -> "GeometricWorld":
        described = self.cell.bodies[body]
        assert described.guide is not None
        guide, axis = described.guide, np.array(described.guide.axis)
        if guide.kind is JointKind.PRISMATIC:
            along = transforms.translation(*(value * axis))
        else:
            along = transforms.transform(transforms.rotation(guide.axis, value), np.zeros(3))
        placement = described.placement
        return self.put(body, placement.parent, matmul(transforms.of_pose(placement.pose), along))

    def grip(self, body: str) -> Floats:
        """T_body_grip (4, 4): where a hand takes a body.

        It is the body's own frame if there is no feature `grip`.
        """
        features = self.cell.bodies[body].features
        return transforms.of_pose(features["grip"]) if "grip" in features else np.eye(4)

    def held(self, body: str, arm: str) -> "GeometricWorld":
        """The world with a body in an arm's hand: the body's grip is at the tool point.

        Raises as `affix` does.
        """
        return self.put(body, f"{arm}.tool", transforms.inverse(self.grip(body)))

    def of_arms(self, arms: Collection[str]) -> "GeometricWorld":
        """The world with some arms alone: the others are left out, with all that rides on them."""
        gone = self.cell.arms.keys() - set(arms)
        if not gone:
            return self
        away = tuple(f"{arm}." for arm in gone)
        removed = {
            name
            for name in self.placed
            if any(support.startswith(away) for support in self.supports(name))
        }
        bodies = {name: body for name, body in self.cell.bodies.items() if name not in removed}
        own = {name: arm for name, arm in self.cell.arms.items() if name not in gone}
        placed = {name: fixed for name, fixed in self.placed.items() if name not in removed}
        configurations = {name: q for name, q in self.configurations.items() if name not in gone}
        return GeometricWorld(replace(self.cell, arms=own, bodies=bodies), placed, configurations)

    def supports(self, frame: str) -> tuple[str, ...]:
        """The frame, the frame that it stands on, and so on, down to the world."""
        chain = [frame]
        while chain[-1] != WORLD_FRAME:
            at = chain[-1]
            arm = at.partition(".")[0]
            chain.append(self.placed[at].parent if at in self.placed else f"{arm}.base")
        return tuple(chain)


def world_after_facts(world: GeometricWorld, facts: Iterable[Atom]) -> GeometricWorld:
    """The world with every body where the facts put it.

    Other bodies, and those at places without a pose, stay where they are. If several locations put
    one body somewhere for a fact, the first one in the file counts.
    """
    for fact in sorted(facts, key=str):
        world = _after_fact(world, fact)
    return world


def _after_fact(world: GeometricWorld, fact: Atom) -> GeometricWorld:
    done: set[str] = set()
    for location in world.cell.locations:
        bindings = match_term(location.fact, fact, {})
        if bindings is None:
            continue
        body = str(substitute_term(location.body, bindings))
        if body in world.cell.bodies and body not in done:
            world = _put_body(world, body, location, bindings)
        done.add(body)
    return world


def _put_body(
    world: GeometricWorld, body: str, location: Location, bindings: Substitution
) -> GeometricWorld:
    if location.value is not None:
        return world.guided(body, location.value) if world.cell.bodies[body].guide else world
    at = _grip_at(world, location, bindings)
    if at is None:
        return world
    frame, T_frame_grip = at
    by = f"{body}.{location.by}"
    T_body_grip = world.pose(body, by) if location.by and by in world.placed else world.grip(body)
    return world.put(body, frame, matmul(T_frame_grip, transforms.inverse(T_body_grip)))


def _grip_at(
    world: GeometricWorld, location: Location, bindings: Substitution
) -> tuple[str, Floats] | None:
    """The frame that the body stands on, and the pose of its grip in it; None for an unknown
    place.
    """
    if location.place is None:
        return _frame_name(location.frame, bindings), np.eye(4)
    place = world.cell.places.get(str(substitute_term(location.place, bindings)))
    if place is None:
        return None
    return place.placement.parent, transforms.of_pose(place.placement.pose)


def _frame_name(name: str, bindings: Substitution) -> str:
    """The name of a frame with a variable in its first part replaced."""
    first, dot, rest = name.partition(".")
    return f"{substitute_term(Variable(first), bindings)}{dot}{rest}"
