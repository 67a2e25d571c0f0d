"""The contact model: object classes, anchor points, contacts, and octuples naming them.

After Matthiesen, section 4. Lengths are in metres, angles in radians. Nothing is computed here;
`cellwright.engine.stages.states` generates the contact states.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.body_shapes import IDENTITY_POSE, Pose
from cellwright.kb.terms import Atom

ANY, VOID = "*", "void"
_VARIABLE_NAME = re.compile(r"[A-Z][A-Za-z0-9_]*")
_OCTUPLE_NAME = re.compile(r"\*|[A-Za-z][A-Za-z0-9_]*")
_QUADRUPLE_FIELDS = ("object class", "object", "anchor class", "anchor point")


@dataclass(frozen=True, slots=True, order=True)
class Quadruple:
    """An anchor point, or a template of anchor points."""

    object_class: str = ANY
    instance: str = ANY
    anchor_class: str = ANY
    anchor: str = ANY

    def __str__(self) -> str:
        return f"{self.object_class}:{self.instance}.{self.anchor_class}:{self.anchor}"

    @property
    def void(self) -> bool:
        """Whether it says that nothing is there."""
        return self.instance == VOID


@dataclass(frozen=True, slots=True, order=True)
class Octuple:
    """A contact of two anchor points, or a template of contacts; `second` is void for a free
    anchor point.
    """

    first: Quadruple
    second: Quadruple

    def __str__(self) -> str:
        return f"{self.first} - {self.second}"

    @property
    def turned(self) -> "Octuple":
        """The same contact, named from its other end."""
        return Octuple(self.second, self.first)

    @property
    def order(self) -> int:
        """The order of the contact class that it describes: 1 anchor classes, 2 object classes
        too, 3 anchor points too.
        """
        ends = (self.first, self.second)
        if any(end.anchor != ANY and not is_variable_name(end.anchor) for end in ends):
            return 3
        return 2 if any(end.object_class != ANY for end in ends) else 1


class NotAnOctuple(ValueError):
    """A text that is no octuple. `offset` is the character at which it goes wrong."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset


def is_variable_name(name: str) -> bool:
    """Whether the name of an instance or an anchor point is a variable."""
    return _VARIABLE_NAME.fullmatch(name) is not None


def void_of(anchor_class: str) -> Quadruple:
    """The partner of a free anchor point: what could be there has this anchor class."""
    return Quadruple(ANY, VOID, anchor_class, VOID)


def parse_octuple(text: str, classes: Collection[str] = ()) -> Octuple:
    """The octuple in a text, in the normal form or in one of the paper's variants. Raises
    `NotAnOctuple`.

    The variants: no blanks, a dot in place of a colon, a hyphen in a name, and no hyphen between
    the quadruples, where a variable, `*` or one of the known object `classes` shows where the
    second one begins.
    """
    bare = "".join(text.split())
    fields = re.split("[:.]", bare)
    if len(fields) != 7:
        raise NotAnOctuple(
            f"{len(fields) + 1} of 8 names: a contact has two anchor points of four names each"
        )
    anchor, object_class = _split_quadruples(fields[3], classes)
    names = [
        _read_name(field_text, n)
        for n, field_text in enumerate([*fields[:3], anchor, object_class, *fields[4:]])
    ]
    return Octuple(Quadruple(*names[:4]), Quadruple(*names[4:]))


def _read_name(text: str, place: int) -> str:
    """A name with `_` for the hyphens that the paper also writes."""
    name = text.replace("-", "_")
    if _OCTUPLE_NAME.fullmatch(name) is None:
        raise NotAnOctuple(f"'{text}' is no name of an {_QUADRUPLE_FIELDS[place % 4]}")
    return name


def _split_quadruples(text: str, classes: Collection[str]) -> tuple[str, str]:
    """The last name of the first quadruple and the first name of the second, which a hyphen
    parts, or nothing.
    """
    cuts = [(text[: cut.start()], text[cut.end() :]) for cut in re.finditer("-", text)]
    known = [(left, right) for left, right in cuts if right in classes or right == ANY]
    if known or cuts:
        return (known or cuts)[0]
    if text.endswith(ANY) and len(text) > 1:
        return text[:-1], ANY
    ends = sorted(
        (class_name for class_name in classes if text.endswith(class_name) and text != class_name),
        key=len,
    )
    if ends:
        return text.removesuffix(ends[-1]), ends[-1]
    joined = re.fullmatch(r"([A-Z][0-9]+)([A-Za-z]\w*)", text)
    if joined is None:
        raise NotAnOctuple(f"no hyphen between the two anchor points: '{text}'")
    return joined[1], joined[2]


Bindings = Mapping[str, str]
NO_BINDINGS: Bindings = MappingProxyType({})


def match_quadruple(
    template: Quadruple, point: Quadruple, kinds: Collection[str], bound: Bindings = NO_BINDINGS
) -> Bindings | None:
    """The bindings with which a template describes an anchor point of an object of these `kinds`,
    or None.

    `kinds` are the object's class and the classes above it.
    """
    if template.object_class not in (ANY, *kinds) or template.anchor_class not in (
        ANY,
        point.anchor_class,
    ):
        return None
    bindings = dict(bound)
    for wanted, name, key in (
        (template.instance, point.instance, template.instance),
        (template.anchor, point.anchor, f"{template.instance}.{template.anchor}"),
    ):
        if is_variable_name(wanted):
            if bindings.setdefault(key, name) != name:
                return None
        elif wanted not in (ANY, name):
            return None
    return bindings


def number_objects(octuples: Collection[Octuple]) -> tuple[Octuple, ...]:
    """Octuples with their objects numbered O1, O2, ... in the order in which they appear.

    Variables of points stay.
    """
    names: dict[str, str] = {}

    def renamed(point: Quadruple) -> Quadruple:
        if point.void or point.instance == ANY:
            return point
        return replace(point, instance=names.setdefault(point.instance, f"O{len(names) + 1}"))

    return tuple(Octuple(renamed(octuple.first), renamed(octuple.second)) for octuple in octuples)


def named_in(octuple: Octuple) -> Iterator[Quadruple]:
    """Both anchor points of an octuple that are not void."""
    yield from (quadruple for quadruple in (octuple.first, octuple.second) if not quadruple.void)


@dataclass(frozen=True, slots=True)
class AnchorPoint:
    """A contact frame on an object: `pose` is T_object_anchor. Keys match locks only."""

    name: str
    anchor_class: str
    key: bool
    pose: Pose = IDENTITY_POSE
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class ObjectClass:
    """Objects with the same anchor points.

    `anchors` includes those of the classes above; `lineage` begins with itself.
    """

    name: str
    lineage: tuple[str, ...]
    anchors: Mapping[str, AnchorPoint] = field(default_factory=dict)
    where: Source = field(default=NOWHERE, compare=False)


GROUND_OBJECT = "ground"


class OneWay(Enum):
    """In which direction a contact can be changed only."""

    NO = ""
    MAKING = "make"  # snap fittings, welds: the clusters are fused
    BREAKING = "break"  # one-way disassembly: the cluster is split


@dataclass(frozen=True, slots=True)
class ContactClass:
    """Contacts that a template describes; `key` and `lock` are its two ends.

    `freedom` lists mechanical degrees of freedom, such as `turn z`; a contact without any is fixed.
    A contact class that stands `over` another is made and broken only while that one holds between
    the same objects, and keeps it.
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
    """A contact that is never taken apart: a joint, or fixed if there is no `freedom`. `first` may
    be the `ground`.

    A joint is controllable, driven by another object (`by`), or passive. `settings` are the named
    states of the joint, each with the pose (a displacement of the second object along the first
    one's frame) that it means.
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
    """Whether the contacts of a template matter in clusters in which `during` holds (None: in
    all).
    """

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
    """A condition at run time on making or breaking the contacts of a template, in clusters in
    which `during` holds.
    """

    contact: Octuple
    kind: ConditionKind
    subject: str  # the joint, the sensor or the clock
    value: str
    during: Octuple | None = None

    def __str__(self) -> str:
        return f"{self.kind.value} {self.subject} is {self.value}"


@dataclass(frozen=True, slots=True)
class Meaning:
    """The facts of the domain that a contact stands for, while it holds and when it is broken.

    Variables are objects.
    """

    contact: Octuple
    made: tuple[Atom, ...]
    broken: tuple[Atom, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class ContactModel:
    """The whole model. Mappings keep the order of declaration.

    `objects` gives the class of each instance.
    """

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
    # objects: the bodies of the cell that they are
    bodies: Mapping[str, str] = field(default_factory=dict)
    path: str = ""

    def kinds(self, instance: str) -> tuple[str, ...]:
        """The class of an object and the classes above it."""
        return self.classes[self.objects[instance]].lineage

    def point(self, instance: str, anchor: str) -> Quadruple:
        """The fully specified quadruple of an anchor point."""
        kind = self.objects[instance]
        return Quadruple(kind, instance, self.classes[kind].anchors[anchor].anchor_class, anchor)


def class_of(
    contact: Octuple,
    contact_classes: Mapping[str, ContactClass],
    classes: Mapping[str, ObjectClass],
) -> ContactClass | None:
    """The first contact class whose template describes a contact that has its key first, or
    None.
    """
    first, second = (
        classes[quadruple.object_class].lineage for quadruple in (contact.first, contact.second)
    )
    for contact_class in contact_classes.values():
        bound = match_quadruple(contact_class.key, contact.first, first)
        if (
            bound is not None
            and match_quadruple(contact_class.lock, contact.second, second, bound) is not None
        ):
            return contact_class
    return None


def template_bindings(
    model: ContactModel, template: Octuple, contact: Octuple, bound: Bindings = NO_BINDINGS
) -> Iterator[Bindings]:
    """The bindings with which a template describes a contact, named from either end."""
    for turned in (contact, contact.turned):
        first = match_quadruple(
            template.first, turned.first, model.kinds(turned.first.instance), bound
        )
        if first is not None:
            second = match_quadruple(
                template.second, turned.second, model.kinds(turned.second.instance), first
            )
            if second is not None:
                yield second
