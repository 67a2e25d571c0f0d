"""Contacts in the notation of THEMSE (Matthiesen, section 4 and appendix): quadruples name anchor points, octuples name contacts.

The normal form is `class:instance.anchor_class:anchor - class:instance.anchor_class:anchor`. `*` stands for anything,
a name that begins with a capital O or A and a number is a variable, and `*:void.anchor_class:void` is a free anchor point.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

ANY, VOID = "*", "void"
_VARIABLE = re.compile(r"[A-Z][A-Za-z0-9_]*")
_NAME = re.compile(r"\*|[A-Za-z][A-Za-z0-9_]*")
_FIELDS = ("object class", "object", "anchor class", "anchor point")


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
    """A contact of two anchor points, or a template of contacts; `second` is void for a free anchor point."""

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
        """The order of the contact class that it describes: 1 anchor classes, 2 object classes too, 3 anchor points too."""
        ends = (self.first, self.second)
        if any(each.anchor != ANY and not variable(each.anchor) for each in ends):
            return 3
        return 2 if any(each.object_class != ANY for each in ends) else 1


class NotAnOctuple(ValueError):
    """A text that is no octuple. `offset` is the character at which it goes wrong."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset


def variable(name: str) -> bool:
    """Whether the name of an instance or an anchor point is a variable."""
    return _VARIABLE.fullmatch(name) is not None


def void_of(anchor_class: str) -> Quadruple:
    """The partner of a free anchor point: what could be there has this anchor class."""
    return Quadruple(ANY, VOID, anchor_class, VOID)


def parse_octuple(text: str, classes: Collection[str] = ()) -> Octuple:
    """The octuple in a text, in the normal form or in one of the paper's variants. Raises `NotAnOctuple`.

    The variants: no blanks, a dot in place of a colon, a hyphen in a name, and no hyphen between the quadruples,
    where a variable, `*` or one of the known object `classes` shows where the second one begins.
    """
    bare = "".join(text.split())
    fields = re.split("[:.]", bare)
    if len(fields) != 7:
        raise NotAnOctuple(
            f"{len(fields) + 1} of 8 names: a contact has two anchor points of four names each"
        )
    anchor, object_class = _parted(fields[3], classes)
    names = [_name(each, n) for n, each in enumerate([*fields[:3], anchor, object_class, *fields[4:]])]
    return Octuple(Quadruple(*names[:4]), Quadruple(*names[4:]))


def _name(text: str, place: int) -> str:
    """A name with `_` for the hyphens that the paper also writes."""
    name = text.replace("-", "_")
    if _NAME.fullmatch(name) is None:
        raise NotAnOctuple(f"'{text}' is no name of an {_FIELDS[place % 4]}")
    return name


def _parted(text: str, classes: Collection[str]) -> tuple[str, str]:
    """The last name of the first quadruple and the first name of the second, which a hyphen parts, or nothing."""
    cuts = [(text[: cut.start()], text[cut.end() :]) for cut in re.finditer("-", text)]
    known = [(left, right) for left, right in cuts if right in classes or right == ANY]
    if known or cuts:
        return (known or cuts)[0]
    if text.endswith(ANY) and len(text) > 1:
        return text[:-1], ANY
    ends = sorted((each for each in classes if text.endswith(each) and text != each), key=len)
    if ends:
        return text.removesuffix(ends[-1]), ends[-1]
    joined = re.fullmatch(r"([A-Z][0-9]+)([A-Za-z]\w*)", text)
    if joined is None:
        raise NotAnOctuple(f"no hyphen between the two anchor points: '{text}'")
    return joined[1], joined[2]


Bindings = Mapping[str, str]
NOTHING: Bindings = MappingProxyType({})


def matches(
    template: Quadruple, point: Quadruple, kinds: Collection[str], bound: Bindings = NOTHING
) -> Bindings | None:
    """The bindings with which a template describes an anchor point of an object of these `kinds`, or None.

    `kinds` are the object's class and the classes above it.
    """
    if template.object_class not in (ANY, *kinds) or template.anchor_class not in (ANY, point.anchor_class):
        return None
    found = dict(bound)
    for wanted, name, key in (
        (template.instance, point.instance, template.instance),
        (template.anchor, point.anchor, f"{template.instance}.{template.anchor}"),
    ):
        if variable(wanted):
            if found.setdefault(key, name) != name:
                return None
        elif wanted not in (ANY, name):
            return None
    return found


def numbered(octuples: Collection[Octuple]) -> tuple[Octuple, ...]:
    """Octuples with their objects numbered O1, O2, ... in the order in which they appear. Variables of points stay."""
    names: dict[str, str] = {}

    def renamed(point: Quadruple) -> Quadruple:
        if point.void or point.instance == ANY:
            return point
        return replace(point, instance=names.setdefault(point.instance, f"O{len(names) + 1}"))

    return tuple(Octuple(renamed(each.first), renamed(each.second)) for each in octuples)


def named_in(octuple: Octuple) -> Iterator[Quadruple]:
    """Both anchor points of an octuple that are not void."""
    yield from (each for each in (octuple.first, octuple.second) if not each.void)
