"""A filter of contact states: whether the parts whose contact changes overlap with others then.

Fixtures stand where the cell has them, moved by the settings of their joints that the change needs.
Every other object stands where its contacts put it: the frames of two anchor points in contact
coincide. The way from one contact state to the next is not looked at here.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.collision_scene import free_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import BodyKind
from cellwright.kb.model.contact_model import (
    ConditionKind,
    ContactModel,
    Octuple,
    PermanentContact,
    Quadruple,
    class_of,
    template_bindings,
)
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.targets import CELL_FILE

TOLERANCE_M = 0.001  # what touches is not yet in the way


class CollisionOfContacts:
    """Asks the geometry backend about the bodies of a cluster."""

    def __init__(self, model: ContactModel) -> None:
        self.model = model
        path = Path(model.path).with_name(CELL_FILE)
        if not path.is_file():
            hint = "write a cell.yaml, or leave `collision` out of the filters"
            message = "the filter 'collision' needs the geometry of the cell"
            raise InvalidInput([Diagnostic(Source(str(path)), "K405", message, hint)])
        self.world = GeometricWorld.of(load_cell(path))
        self.backend = geometry_backend()

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The anchor points of classes for which it makes a difference which of several is
        taken.
        """
        individuals = set()
        for kind in self.model.classes.values():
            groups: dict[str, list[str]] = {}
            for anchor in kind.anchors.values():
                groups.setdefault(anchor.anchor_class, []).append(anchor.name)
            for anchors in groups.values():
                verdicts = (
                    {self._verdicts(kind.name, anchor) for anchor in anchors}
                    if len(anchors) > 1
                    else set()
                )
                if len(verdicts) > 1:
                    individuals |= {(kind.name, anchor) for anchor in anchors}
        return frozenset(individuals)

    def _verdicts(self, kind: str, anchor: str) -> tuple[bool, ...]:
        """Whether each object that fits collides at an anchor point, alone and in each hand."""
        holder = next((instance for instance, of in self.model.objects.items() if of == kind), None)
        return tuple(self._collisions(holder, anchor)) if holder in self._fixtures else ()

    def _collisions(self, holder: str | None, anchor: str) -> Iterator[bool]:
        assert holder is not None
        lock = self.model.point(holder, anchor)
        for contact in self._candidates(lock):
            own = contact.first.instance
            yield bool(self.reason((holder, own), (contact,), contact))
            for point in self._points(own):
                for grip in self._candidates(point):
                    hand = grip.first.instance
                    yield bool(self.reason((holder, own, hand), (contact, grip), contact))

    def _points(self, instance: str) -> Iterator[Quadruple]:
        for anchor in self.model.classes[self.model.objects[instance]].anchors:
            yield self.model.point(instance, anchor)

    def _candidates(self, lock: Quadruple) -> Iterator[Octuple]:
        """A contact at a lock for each class of objects that has a key for it."""
        seen = set()
        for instance, kind in self.model.objects.items():
            if kind not in seen and instance != lock.instance:
                seen.add(kind)
                for point in self._points(instance):
                    contact = Octuple(point, lock)
                    if (
                        class_of(contact, self.model.contact_classes, self.model.classes)
                        is not None
                    ):
                        yield contact

    @cached_property
    def _fixtures(self) -> frozenset[str]:
        """The objects that stand where the cell has them."""
        bodies = self.world.cell.bodies
        named = ((name, self.model.bodies.get(name, name)) for name in self.model.objects)
        return frozenset(
            name for name, body in named if body in bodies and bodies[body].kind is BodyKind.FIXTURE
        )

    def reason(
        self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple | None
    ) -> str:
        """Which two bodies overlap; empty if none do, or if no contact is made."""
        if change is None:
            return ""
        poses = self._poses([*objects, *self._attached(objects)], contacts, change)
        world = self.world
        bodies = {name: self._body(name) for name in poses}
        for name_entry, T in poses.items():
            world = world.put(bodies[name_entry], WORLD_FRAME, T)
        touching = {
            frozenset({bodies[c.first.instance], bodies[c.second.instance]})
            for c in contacts
            if {c.first.instance, c.second.instance} <= bodies.keys()
        }
        standing = [name for name in world.cell.bodies if name not in bodies.values()]
        concerned = {change.first.instance, change.second.instance, *self._held(change, contacts)}
        for each in sorted(concerned & poses.keys() - self._fixtures):
            scene = free_scene_of(world, bodies[each], standing, frozenset(touching))
            for hit in self.backend.checker(scene).contacts(poses[each], 0.0):
                if hit.depth_m > TOLERANCE_M:
                    return f"{self._kind(hit.first)} touches {self._kind(hit.second)}"
        return ""

    def _held(self, change: Octuple, contacts: Sequence[Octuple]) -> Iterator[str]:
        """What is in contact with the two parts."""
        ends = {change.first.instance, change.second.instance}
        for contact in contacts:
            pair = {contact.first.instance, contact.second.instance}
            if pair & ends:
                yield from pair - self._fixtures

    def _body(self, instance: str) -> str:
        return self.model.bodies.get(instance, instance)

    def _kind(self, body: str) -> str:
        instance = next((o for o, name in self.model.bodies.items() if name == body), body)
        return self.model.objects.get(instance, body)

    def _attached(self, objects: Sequence[str]) -> Iterator[str]:
        """What moves with joints of these objects, as the flap of a furnace."""
        for joint in self.model.permanent.values():
            if joint.first in objects and joint.second not in objects:
                yield joint.second

    def _poses(
        self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple
    ) -> dict[str, Floats]:
        """T_world_object (4, 4) of each object that is a body: fixtures as their joints are,
        the others by their contacts.
        """
        settings = self._settings(contacts, change)
        poses = {name: self._standing(name, settings) for name in objects if name in self._fixtures}
        if not poses:
            poses = {change.first.instance: np.eye(4)}
        open_ = deque(poses)
        while open_:
            at = open_.popleft()
            for contact in contacts:
                for near, far in ((contact.first, contact.second), (contact.second, contact.first)):
                    if near.instance == at and far.instance not in poses:
                        T = matmul(
                            poses[at], self._anchor(near), transforms.inverse(self._anchor(far))
                        )
                        poses[far.instance] = T
                        open_.append(far.instance)
        return {name: T for name, T in poses.items() if self._body(name) in self.world.cell.bodies}

    def _anchor(self, point: Quadruple) -> Floats:
        return transforms.of_pose(self.model.classes[point.object_class].anchors[point.anchor].pose)

    def _settings(self, contacts: Sequence[Octuple], change: Octuple) -> Mapping[str, str]:
        """The settings of the joints in which the change happens."""
        settings = {name: joint.starts for name, joint in self.model.permanent.items()}
        for restriction in self.model.restrictions:
            for bound in template_bindings(self.model, restriction.contact, change):
                applies = restriction.during is None or any(
                    next(template_bindings(self.model, restriction.during, contact, bound), None)
                    is not None
                    for contact in contacts
                )
                if restriction.kind is ConditionKind.JOINT and applies:
                    settings[restriction.subject] = restriction.value
        return settings

    def _standing(self, instance: str, settings: Mapping[str, str]) -> Floats:
        T = self.world.pose(WORLD_FRAME, self._body(instance))
        joint = next(
            (
                permanent
                for permanent in self.model.permanent.values()
                if self._moves(permanent, instance)
            ),
            None,
        )
        if joint is None or not settings[joint.name]:
            return T
        moved: Floats = matmul(T, transforms.of_pose(joint.settings[settings[joint.name]]))
        return moved

    @staticmethod
    def _moves(joint: PermanentContact, instance: str) -> bool:
        return joint.second == instance and bool(joint.settings)
