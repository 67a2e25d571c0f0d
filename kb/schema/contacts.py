"""The form of a contact model, `contacts.yaml`."""

from typing import Annotated, Literal

from pydantic import Field

from cellwright.kb.schema.form_base import Expression, Names, Strict, Truth
from cellwright.kb.schema.geometry_forms import PoseEntry, UnitsEntry

Template = Annotated[
    str,
    Field(
        description="class:object.anchor_class:anchor - class:object.anchor_class:anchor; * for "
        "anything"
    ),
]
Say = Annotated[str, Field(description="a description for people, in a few words")]


class AnchorEntry(PoseEntry):
    """An anchor point: a frame on the object, and the class of its key or lock."""

    key: str | None = Field(None, description="the anchor class, if it is a key")
    lock: str | None = Field(None, description="the anchor class, if it is a lock")


class ClassEntry(Strict):
    """A class of objects."""

    parent: str | None = Field(None, description="the class whose anchor points it has, too")
    anchors: dict[str, AnchorEntry] = Field(
        default_factory=dict, description="anchor points, or ranges of them such as depot_1..4"
    )


class ContactClassEntry(Strict):
    """A class of contacts: which anchor points match, and what their contact is like."""

    contact: Template
    make: str = Field("join", description="the operator that makes such a contact: grip, insert")
    break_: str = Field(
        "part",
        alias="break",
        description="the operator that breaks such a contact: release, withdraw",
    )
    freedom: list[str] = Field(
        default_factory=list,
        description="degrees of freedom: `slide x`, `turn z`; none if it is fixed",
    )
    controllable: Truth = Field(
        False, description="a controller moves or holds it, as the jaws of a gripper"
    )
    supports: Truth = Field(True, description="it keeps an object from falling")
    one_way: Literal["make", "break"] | None = Field(
        None, description="it can only be made (snap, weld) or only be broken (one-way disassembly)"
    )
    over: str | None = Field(
        None,
        description="the contact class that holds between the same objects before, meanwhile and "
        "after",
    )


class SettingEntry(PoseEntry):
    """A named state of a joint: the displacement of the second object."""


class PermanentEntry(Strict):
    """A contact that is never taken apart."""

    between: list[str] = Field(
        min_length=2, max_length=2, description="two objects; the first may be `ground`"
    )
    freedom: list[str] = Field(
        default_factory=list,
        description="degrees of freedom: `slide x`, `turn z`; none if it is fixed",
    )
    controllable: Truth = Field(
        False, description="a controller moves it, as the joints of a robot"
    )
    by: str | None = Field(
        None, description="the object that is handled in order to move it, as a switch"
    )
    settings: dict[str, SettingEntry | None] = Field(
        default_factory=dict, description="the states of the joint that matter"
    )
    starts: str | None = Field(
        None, description="the setting at the start; the first one if left out"
    )
    fact: Expression | None = Field(
        None, description="the fact of the domain for a setting, as in position(drawer, Setting)"
    )


class UndesirableEntry(Strict):
    """Contacts that must not hold together in one cluster."""

    contacts: list[Template] = Field(
        min_length=1, description="templates; the same variable is the same object"
    )
    say: Say = ""


class RelevanceEntry(Strict):
    """Which contacts matter in which clusters."""

    contact: Template
    matters: Truth = Field(description="true: it is distinguished; false: it is not")
    while_: Template | None = Field(
        None, alias="while", description="in clusters with this contact; in all if left out"
    )


class RestrictionEntry(Strict):
    """A condition at run time on making or breaking contacts: a joint, a sensor or a time."""

    contact: Template
    while_: Template | None = Field(
        None, alias="while", description="in clusters with this contact; in all if left out"
    )
    joint: str | None = Field(None, description="the permanent contact whose setting is looked at")
    sensor: str | None = Field(None, description="the sensor that is read")
    time: str | None = Field(None, description="the clock that is looked at")
    is_: str = Field(alias="is", description="the setting, the reading or the time that is needed")


class MeaningEntry(Strict):
    """The facts of the domain that a contact stands for."""

    contact: Template
    made: Expression
    broken: Expression | None = Field(
        None, description="facts that hold when the contact is broken"
    )


class ContactsFile(Strict):
    """A `contacts.yaml` beside a domain: object classes, anchor points and the contacts that
    objects can have.
    """

    contacts: str = Field(description="the name of the domain beside this file")
    units: UnitsEntry | None = Field(None, description="units of numbers without a unit")
    gravity: Truth = Field(
        True, description="false: what nothing holds stays where it is, as in orbit"
    )
    classes: dict[str, ClassEntry | None] = Field(min_length=1, description="classes of objects")
    objects: dict[str, Names] = Field(min_length=1, description="class: its instances")
    contact_classes: dict[str, ContactClassEntry] = Field(
        min_length=1, description="which contacts there can be"
    )
    permanent: dict[str, PermanentEntry] = Field(
        default_factory=dict, description="contacts that are never taken apart"
    )
    initial: list[Template] = Field(default_factory=list, description="the contacts at the start")
    undesirable: dict[str, UndesirableEntry] = Field(
        default_factory=dict, description="contacts that the designer excludes"
    )
    relevance: list[RelevanceEntry] = Field(
        default_factory=list,
        description="what matters beyond, or less than, what the engine distinguishes",
    )
    restrictions: list[RestrictionEntry] = Field(
        default_factory=list, description="conditions at run time"
    )
    facts: list[MeaningEntry] = Field(
        default_factory=list, description="what contacts mean in the domain beside this file"
    )
    processes: list[str] = Field(
        default_factory=list,
        description="operators of the domain that change no contact, such as heat",
    )
    bodies: dict[str, str] = Field(
        default_factory=dict,
        description="object: the body of cell.yaml that it is, where that has another name",
    )
    filters: list[str] = Field(
        default_factory=lambda: ["stability", "templates"],
        description="the filters that contact states pass: stability, templates, collision, or "
        "plug-ins",
    )
