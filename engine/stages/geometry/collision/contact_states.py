"""A filter of contact states: do the parts whose contact changes overlap with others in the end state?

Fixtures stand where the cell has them, moved by the settings of their joints that the change needs. Every other object
stands where its contacts put it: the frames of two anchor points in contact coincide. The way from one contact state to the
next is not looked at here.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import free_scene_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell import WORLD, BodyKind
from cellwright.kb.model.contacts import ConditionKind, ContactModel, PermanentContact, describes
from cellwright.kb.model.octuples import Octuple, Quadruple
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
        self.world = World.of(load_cell(path))
        self.backend = geometry_backend()

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The anchor points of classes for which it makes a difference which of several is taken."""
        found = set()
        for kind in self.model.classes.values():
            groups: dict[str, list[str]] = {}
            for each in kind.anchors.values():
                groups.setdefault(each.anchor_class, []).append(each.name)
            for anchors in groups.values():
                verdicts = (
                    {self._verdicts(kind.name, each) for each in anchors} if len(anchors) > 1 else set()
                )
                if len(verdicts) > 1:
                    found |= {(kind.name, each) for each in anchors}
        return frozenset(found)

    def _verdicts(self, kind: str, anchor: str) -> tuple[bool, ...]:
        """Whether each object that fits collides at an anchor point, alone and in each hand."""
        holder = next((each for each, of in self.model.objects.items() if of == kind), None)
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
        from cellwright.kb.model.contacts import class_of

        seen = set()
        for instance, kind in self.model.objects.items():
            if kind not in seen and instance != lock.instance:
                seen.add(kind)
                for point in self._points(instance):
                    contact = Octuple(point, lock)
                    if class_of(contact, self.model.contact_classes, self.model.classes) is not None:
                        yield contact

    @cached_property
    def _fixtures(self) -> frozenset[str]:
        """The objects that stand where the cell has them."""
        bodies = self.world.cell.bodies
        named = ((each, self.model.bodies.get(each, each)) for each in self.model.objects)
        return frozenset(
            each for each, body in named if body in bodies and bodies[body].kind is BodyKind.FIXTURE
        )

    def reason(self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple | None) -> str:
        """Which two bodies overlap; empty if none do, or if no contact is made."""
        if change is None:
            return ""
        poses = self._poses([*objects, *self._attached(objects)], contacts, change)
        world = self.world
        bodies = {each: self._body(each) for each in poses}
        for each, T in poses.items():
            world = world.put(bodies[each], WORLD, T)
        touching = {
            frozenset({bodies[c.first.instance], bodies[c.second.instance]})
            for c in contacts
            if {c.first.instance, c.second.instance} <= bodies.keys()
        }
        others = [name for name in world.cell.bodies if name not in bodies.values()]
        concerned = {change.first.instance, change.second.instance, *self._held(change, contacts)}
        for each in sorted(concerned & poses.keys() - self._fixtures):
            scene = free_scene_of(world, bodies[each], others, frozenset(touching))
            for hit in self.backend.checker(scene).contacts(poses[each], 0.0):
                if hit.depth_m > TOLERANCE_M:
                    return f"{self._kind(hit.first)} touches {self._kind(hit.second)}"
        return ""

    def _held(self, change: Octuple, contacts: Sequence[Octuple]) -> Iterator[str]:
        """What is in contact with the two parts."""
        ends = {change.first.instance, change.second.instance}
        for each in contacts:
            pair = {each.first.instance, each.second.instance}
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
        """T_world_object (4, 4) of each object that is a body: fixtures as their joints are, the others by their contacts."""
        settings = self._settings(contacts, change)
        found = {each: self._standing(each, settings) for each in objects if each in self._fixtures}
        if not found:
            found = {change.first.instance: np.eye(4)}
        open_ = deque(found)
        while open_:
            at = open_.popleft()
            for each in contacts:
                for near, far in ((each.first, each.second), (each.second, each.first)):
                    if near.instance == at and far.instance not in found:
                        T = matmul(found[at], self._anchor(near), transforms.inverse(self._anchor(far)))
                        found[far.instance] = T
                        open_.append(far.instance)
        return {each: T for each, T in found.items() if self._body(each) in self.world.cell.bodies}

    def _anchor(self, point: Quadruple) -> Floats:
        return transforms.of_pose(self.model.classes[point.object_class].anchors[point.anchor].pose)

    def _settings(self, contacts: Sequence[Octuple], change: Octuple) -> Mapping[str, str]:
        """The settings of the joints in which the change happens."""
        found = {name: joint.starts for name, joint in self.model.permanent.items()}
        for each in self.model.restrictions:
            for bound in describes(self.model, each.contact, change):
                there = each.during is None or any(
                    next(describes(self.model, each.during, contact, bound), None) is not None
                    for contact in contacts
                )
                if each.kind is ConditionKind.JOINT and there:
                    found[each.subject] = each.value
        return found

    def _standing(self, instance: str, settings: Mapping[str, str]) -> Floats:
        T = self.world.pose(WORLD, self._body(instance))
        joint = next((each for each in self.model.permanent.values() if self._moves(each, instance)), None)
        if joint is None or not settings[joint.name]:
            return T
        moved: Floats = matmul(T, transforms.of_pose(joint.settings[settings[joint.name]]))
        return moved

    @staticmethod
    def _moves(joint: PermanentContact, instance: str) -> bool:
        return joint.second == instance and bool(joint.settings)
