"""The contact model in `contacts.yaml`: object classes with anchor points, and the contacts that objects can have.

After Matthiesen, section 4. Lengths are in metres, angles in radians. Nothing is computed here; `cellwright.engine.stages.states`
generates the contact states.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.octuples import NOTHING, Bindings, Octuple, Quadruple, matches
from cellwright.kb.model.shapes import HERE, Pose
from cellwright.kb.terms import Atom


@dataclass(frozen=True, slots=True)
class AnchorPoint:
    """A contact frame on an object: `pose` is T_object_anchor. Keys match locks only."""

    name: str
    anchor_class: str
    key: bool
    pose: Pose = HERE
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class ObjectClass:
    """Objects with the same anchor points. `anchors` includes those of the classes above; `lineage` begins with itself."""

    name: str
    lineage: tuple[str, ...]
    anchors: Mapping[str, AnchorPoint] = field(default_factory=dict)
    where: Source = field(default=NOWHERE, compare=False)


GROUND = "ground"


class OneWay(Enum):
    """In which direction a contact can be changed only."""

    NO = ""
    MAKING = "make"  # snap fittings, welds: the clusters are fused
    BREAKING = "break"  # one-way disassembly: the cluster is split


@dataclass(frozen=True, slots=True)
class ContactClass:
    """Contacts that a template describes; `key` and `lock` are its two ends.

    `freedom` lists mechanical degrees of freedom, such as `turn z`; a contact without any is fixed. A contact class that
    stands `over` another is made and broken only while that one holds between the same objects, and keeps it.
    """

    name: str
    template: Octuple
    make: str
    unmake: str
    freedom: tuple[str, ...] = ()
    controllable: bool = False
    supports: bool = True
    one_way: OneWay = OneWay.NO
    over: str = ""
    where: Source = field(default=NOWHERE, compare=False)

    @property
    def rigid(self) -> bool:
        """Whether what hangs on one side goes where the other side goes."""
        return self.controllable or not self.freedom

    @property
    def key(self) -> Quadruple:
        """The end with the key."""
        return self.template.first

    @property
    def lock(self) -> Quadruple:
        """The end with the lock."""
        return self.template.second


@dataclass(frozen=True, slots=True)
class PermanentContact:
    """A contact that is never taken apart: a joint, or fixed if there is no `freedom`. `first` may be the `ground`.

    A joint is controllable, driven by another object (`by`), or passive. `settings` are the named states of the joint,
    each with the pose (a displacement of the second object along the first one's frame) that it means.
    """

    name: str
    first: str
    second: str
    freedom: tuple[str, ...] = ()
    controllable: bool = False
    by: str = ""
    settings: Mapping[str, Pose] = field(default_factory=dict)
    starts: str = ""
    fact: Atom | None = None
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Undesirable:
    """A template of contacts that must not hold together in one cluster."""

    name: str
    contacts: tuple[Octuple, ...]
    say: str = ""
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Relevance:
    """Whether the contacts of a template matter in clusters in which `during` holds (None: in all)."""

    contact: Octuple
    matters: bool
    during: Octuple | None = None


class ConditionKind(Enum):
    """What is looked at while the cell runs."""

    JOINT = "joint"
    SENSOR = "sensor"
    TIME = "time"


@dataclass(frozen=True, slots=True)
class Restriction:
    """A condition at run time on making or breaking the contacts of a template, in clusters in which `during` holds."""

    contact: Octuple
    kind: ConditionKind
    subject: str  # the joint, the sensor or the clock
    value: str
    during: Octuple | None = None

    def __str__(self) -> str:
        return f"{self.kind.value} {self.subject} is {self.value}"


@dataclass(frozen=True, slots=True)
class Meaning:
    """The facts of the domain that a contact stands for, while it holds and when it is broken. Variables are objects."""

    contact: Octuple
    made: tuple[Atom, ...]
    broken: tuple[Atom, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class ContactModel:
    """The whole model. Mappings keep the order of declaration. `objects` gives the class of each instance."""

    name: str
    classes: Mapping[str, ObjectClass] = field(default_factory=dict)
    objects: Mapping[str, str] = field(default_factory=dict)
    contact_classes: Mapping[str, ContactClass] = field(default_factory=dict)
    permanent: Mapping[str, PermanentContact] = field(default_factory=dict)
    initial: tuple[Octuple, ...] = ()
    undesirable: tuple[Undesirable, ...] = ()
    relevance: tuple[Relevance, ...] = ()
    restrictions: tuple[Restriction, ...] = ()
    meanings: tuple[Meaning, ...] = ()
    processes: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()
    gravity: bool = True
    bodies: Mapping[str, str] = field(default_factory=dict)  # objects: the bodies of the cell that they are
    path: str = ""

    def kinds(self, instance: str) -> tuple[str, ...]:
        """The class of an object and the classes above it."""
        return self.classes[self.objects[instance]].lineage

    def point(self, instance: str, anchor: str) -> Quadruple:
        """The fully specified quadruple of an anchor point."""
        kind = self.objects[instance]
        return Quadruple(kind, instance, self.classes[kind].anchors[anchor].anchor_class, anchor)


def class_of(
    contact: Octuple, contact_classes: Mapping[str, ContactClass], classes: Mapping[str, ObjectClass]
) -> ContactClass | None:
    """The first contact class whose template describes a contact that has its key first, or None."""
    first, second = (classes[each.object_class].lineage for each in (contact.first, contact.second))
    for each in contact_classes.values():
        bound = matches(each.key, contact.first, first)
        if bound is not None and matches(each.lock, contact.second, second, bound) is not None:
            return each
    return None


def describes(
    model: ContactModel, template: Octuple, contact: Octuple, bound: Bindings = NOTHING
) -> Iterator[Bindings]:
    """The bindings with which a template describes a contact, named from either end."""
    for turned in (contact, contact.turned):
        first = matches(template.first, turned.first, model.kinds(turned.first.instance), bound)
        if first is not None:
            second = matches(template.second, turned.second, model.kinds(turned.second.instance), first)
            if second is not None:
                yield second
