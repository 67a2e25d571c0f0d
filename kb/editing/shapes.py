"""What each scalar of a file is: an expression, a declaration, a name of something. Tables, one for each kind of file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto


class Role(Enum):
    """What a scalar is."""

    ATOMS = auto()  # an expression of atoms, which its `doing` reads, adds or denies
    TERMS = auto()  # an expression of terms
    SIGNATURE = auto()  # declares a predicate or function: name(type, ...)
    HEADER = auto()  # declares an operator: name(Variable, ...)
    STEP = auto()  # an operator, with arguments or without
    TYPE = auto()
    NEW_TYPE = auto()
    NAME = auto()  # an object, or a range of objects, that the domain or problem declares
    THING = auto()  # an object that is mentioned; what follows a dot or a slash belongs to another name space
    VARIABLE = auto()
    PREDICATE = auto()
    CAUSE = auto()
    NEW_CAUSE = auto()
    FILE = auto()
    DEVICE = auto()
    DOMAIN = auto()
    PATTERN = auto()  # a sentence with slots, {Variable:type}
    SENTENCE = auto()  # a command in words
    TITLE = auto()  # the name of the file itself, or of an entry of it
    TEXT = auto()


@dataclass(frozen=True)
class Shape:
    """What a value may be: a scalar of a role, a mapping with known keys or with others, a list."""

    role: Role = Role.TEXT
    doing: str = ""  # what the expression does with what it names, in words
    keys: Mapping[str, "Shape"] = field(default_factory=dict)
    key: Role | None = None  # of other keys
    key_doing: str = ""
    other: "Shape | None" = None  # the value under other keys
    items: "Shape | None" = None

    def under(self, key: str | int) -> "Shape":
        """The shape of a part."""
        if isinstance(key, int):
            return self.items or TEXT
        return self.keys.get(key) or self.other or TEXT


TEXT = Shape()
TYPE, FILE, CAUSE = Shape(Role.TYPE), Shape(Role.FILE), Shape(Role.CAUSE)
NAME, TERM, THING = Shape(Role.NAME, "declared"), Shape(Role.TERMS, "named"), Shape(Role.THING, "named")
READ, ADDED, DENIED = (Shape(Role.ATOMS, doing) for doing in ("read", "added", "denied"))
GIVEN, STEP = Shape(Role.ATOMS, "given"), Shape(Role.STEP, "named")
TITLE = Shape(Role.TITLE)


def each(key: Role, other: Shape = TEXT, doing: str = "") -> Shape:
    """A mapping from names of one kind."""
    return Shape(key=key, other=other, key_doing=doing)


def some(items: Shape) -> Shape:
    """A list."""
    return Shape(items=items)


TYPES = each(Role.VARIABLE, TYPE)
_MEASURES = {
    name: TERM
    for name in (
        "of",
        "value",
        "by",
        "nominal",
        "tolerance",
        "lower",
        "upper",
        "uncertainty",
        "risk",
        "worth",
        "usual",
    )
}
_COMMAND = Shape(
    keys={"stream": TERM, "reply": TERM, "result": Shape(Role.TERMS), "measures": Shape(keys=_MEASURES)}
)
_CHANGES = each(Role.TERMS, TERM, "changed")
OPERATOR = Shape(
    keys={
        "types": TYPES,
        "where": READ,
        "preconditions": READ,
        "adds": ADDED,
        "deletes": DENIED,
        "effects": some(Shape(keys={"when": READ, "adds": ADDED, "deletes": DENIED})),
        "increase": _CHANGES,
        "decrease": _CHANGES,
        "assign": _CHANGES,
        "resources": Shape(Role.TERMS, "held"),
        "duration": TERM,
        "cost": TERM,
        "command": _COMMAND,
        "online": some(Shape(keys={"fact": READ})),
    }
)
DEDUCTIVE = Shape(keys={"when": READ, "types": TYPES, "where": READ, "implies": ADDED, "denies": DENIED})
PHRASE = Shape(
    keys={"say": Shape(Role.PATTERN), "goal": READ, "stage": READ, "subject": Shape(Role.VARIABLE)}
)
_USES = each(Role.DEVICE, Shape(keys={"device": Shape(Role.DEVICE)}))
DOMAIN = Shape(
    keys={
        "domain": TITLE,
        "use": _USES,
        "without": some(STEP),
        "include": some(FILE),
        "types": each(Role.NEW_TYPE, Shape(Role.TYPE, items=NAME)),
        "functions": each(Role.SIGNATURE, TYPE, "function"),
        "objects": each(Role.TYPE, some(NAME)),
        "statics": each(Role.SIGNATURE, doing="static"),
        "derived": each(Role.SIGNATURE, doing="derived predicate"),
        "fluents": each(Role.SIGNATURE, doing="fluent"),
        "events": each(Role.SIGNATURE, doing="event"),
        "quantities": each(Role.SIGNATURE, doing="quantity"),
        "defaults": some(GIVEN),
        "operators": each(Role.HEADER, OPERATOR),
        "deductive_operators": some(DEDUCTIVE),
        "conventions": Shape(other=Shape(Role.PREDICATE, "named")),
        "commands": Shape(keys={"words": each(Role.THING, some(TEXT)), "phrases": some(PHRASE)}),
    }
)
_EXAMPLE = {"static": GIVEN, "initial": GIVEN, "stage": READ, "goal": READ}
_SECTIONS = {key: shape for key, shape in DOMAIN.keys.items() if key not in ("domain", "without")}
DEVICE = Shape(keys={**_SECTIONS, "device": TITLE, "example": Shape(keys=_EXAMPLE)})
PROBLEM = Shape(
    keys={
        "problem": TITLE,
        "domain": Shape(Role.DOMAIN),
        "objects": each(Role.TYPE, some(NAME)),
        "statics": some(GIVEN),
        "initial": some(GIVEN),
        "durations": each(Role.STEP),
        "goals": some(READ),
        "workflow": some(
            Shape(
                keys={"name": TITLE, "for": each(Role.VARIABLE, some(THING)), "subject": TERM, "stages": READ}
            )
        ),
        "command": Shape(Role.SENTENCE),
    }
)
_ACTION = {"preconditions": READ, "by": STEP}
FAULTS = Shape(
    keys={
        "faults": Shape(Role.DOMAIN),
        "exceptions": Shape(other=Shape(keys={"of": STEP, "causes": each(Role.CAUSE)})),
        "causes": each(
            Role.NEW_CAUSE,
            Shape(
                keys={
                    "doubts": READ,
                    "adds": ADDED,
                    "denies": DENIED,
                    "spoils": DENIED,
                    "loses": some(TERM),
                    "blocks": some(STEP),
                    "since": some(STEP),
                }
            ),
        ),
        "tests": Shape(other=Shape(keys={**_ACTION, "gives": each(Role.CAUSE)})),
        "repairs": Shape(
            other=Shape(
                keys={
                    **_ACTION,
                    "cures": Shape(items=CAUSE, key=Role.CAUSE, other=TEXT),
                    "adds": ADDED,
                    "denies": DENIED,
                    "loses": some(TERM),
                }
            )
        ),
    }
)
_FIXED = each(Role.THING, Shape(keys={"in": THING}), "a body of the cell")
_MOVED = each(
    Role.THING, Shape(keys={"in": THING, "joint": Shape(keys={"follows": THING})}), "a body of the cell"
)
_ARMS = each(Role.THING, Shape(keys={"in": THING, "tool": THING}), "a body of the cell")
_PLACE = Shape(keys={"in": THING, "touches": some(THING), "arm": THING, "tool": THING})
CELL = Shape(
    keys={
        "cell": TITLE,
        "arms": _ARMS,
        **dict.fromkeys(("frames", "regions", "zones"), _FIXED),
        **dict.fromkeys(("fixtures", "parts", "tools"), _MOVED),
        "allowed_contacts": some(some(THING)),
        "places": each(Role.TERMS, _PLACE, "placed"),
        "locations": each(Role.ATOMS, Shape(keys={"body": TERM, "place": TERM, "in": THING}), "read"),
        "operations": each(
            Role.STEP, Shape(keys={"at": TERM, "drags": TERM, "drives": TERM, "with": TERM, "carries": TERM})
        ),
        "measuring": each(Role.THING, Shape(keys={"touches": some(THING)})),
        "sensors": each(Role.THING, Shape(keys={"joint": THING, "force": THING, "load": THING}), "a sensor"),
    }
)
CONTACTS = Shape(
    keys={
        "contacts": Shape(Role.DOMAIN),
        "objects": Shape(other=some(THING)),
        "permanent": Shape(other=Shape(keys={"between": some(THING), "by": THING, "fact": READ})),
        "facts": some(Shape(keys={"made": ADDED, "broken": ADDED})),
    }
)
KINDS: Mapping[str, Shape] = {
    "domain": DOMAIN,
    "device": DEVICE,
    "problem": PROBLEM,
    "faults": FAULTS,
    "cell": CELL,
    "contacts": CONTACTS,
}
"""The shape of each kind of file whose names are indexed; `cellwright.kb.schema` has a form of the same name."""
