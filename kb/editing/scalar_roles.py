"""What each scalar of a file is (expression, declaration, name), by kind of file."""

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
    # an object that is mentioned; what follows a dot or a slash belongs to another name space
    THING = auto()
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
    WINDOW = auto()  # a window of time between two events
    WORKER = auto()  # a resource, or a step
    TEXT = auto()


@dataclass(frozen=True)
class ScalarShape:
    """What a value may be: a scalar of a role, a mapping with known keys or with others, a list."""

    role: Role = Role.TEXT
    doing: str = ""  # what the expression does with what it names, in words
    keys: Mapping[str, "ScalarShape"] = field(default_factory=dict)
    key: Role | None = None  # of other keys
    key_doing: str = ""
    other: "ScalarShape | None" = None  # the value under other keys
    items: "ScalarShape | None" = None

    def under(self, key: str | int) -> "ScalarShape":
        """The shape of a part."""
        if isinstance(key, int):
            return self.items or TEXT_SHAPE
        return self.keys.get(key) or self.other or TEXT_SHAPE


TEXT_SHAPE = ScalarShape()
TYPE, FILE, CAUSE = ScalarShape(Role.TYPE), ScalarShape(Role.FILE), ScalarShape(Role.CAUSE)
NAME, TERM, THING = (
    ScalarShape(Role.NAME, "declared"),
    ScalarShape(Role.TERMS, "named"),
    ScalarShape(Role.THING, "named"),
)
READ, ADDED, DENIED = (ScalarShape(Role.ATOMS, doing) for doing in ("read", "added", "denied"))
GIVEN, STEP = ScalarShape(Role.ATOMS, "given"), ScalarShape(Role.STEP, "named")
TITLE_SHAPE = ScalarShape(Role.TITLE)


def mapping_of(key: Role, other: ScalarShape = TEXT_SHAPE, doing: str = "") -> ScalarShape:
    """A mapping from names of one kind."""
    return ScalarShape(key=key, other=other, key_doing=doing)


def list_of(items: ScalarShape) -> ScalarShape:
    """A list."""
    return ScalarShape(items=items)


TYPES_SHAPE = mapping_of(Role.VARIABLE, TYPE)
_MEASURES_SHAPE = {
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
_COMMAND_SHAPE = ScalarShape(
    keys={
        "stream": TERM,
        "reply": TERM,
        "result": ScalarShape(Role.TERMS),
        "measures": ScalarShape(keys=_MEASURES_SHAPE),
    }
)
_CHANGES_SHAPE = mapping_of(Role.TERMS, TERM, "changed")
OPERATOR_SHAPE = ScalarShape(
    keys={
        "types": TYPES_SHAPE,
        "where": READ,
        "preconditions": READ,
        "adds": ADDED,
        "deletes": DENIED,
        "effects": list_of(ScalarShape(keys={"when": READ, "adds": ADDED, "deletes": DENIED})),
        "increase": _CHANGES_SHAPE,
        "decrease": _CHANGES_SHAPE,
        "assign": _CHANGES_SHAPE,
        "resources": ScalarShape(Role.TERMS, "held"),
        "duration": ScalarShape(
            Role.TERMS, "named", keys=dict.fromkeys(("from", "to", "usual", "spread"), TERM)
        ),
        "cost": TERM,
        "timeout": TERM,
        "command": _COMMAND_SHAPE,
        "online": list_of(ScalarShape(keys={"fact": READ})),
    }
)
DEDUCTIVE_SHAPE = ScalarShape(
    keys={"when": READ, "types": TYPES_SHAPE, "where": READ, "implies": ADDED, "denies": DENIED}
)
PHRASE_SHAPE = ScalarShape(
    keys={
        "say": ScalarShape(Role.PATTERN),
        "goal": READ,
        "stage": READ,
        "subject": ScalarShape(Role.VARIABLE),
    }
)
_USES_SHAPE = mapping_of(Role.DEVICE, ScalarShape(keys={"device": ScalarShape(Role.DEVICE)}))
WINDOW_SHAPE = ScalarShape(
    Role.WINDOW,
    "timed",
    keys={
        "keep": ScalarShape(Role.WINDOW, "timed"),
        "for": mapping_of(Role.VARIABLE, list_of(THING)),
    },
)
TIME_SHAPES = {
    "windows": list_of(WINDOW_SHAPE),
    "calendars": list_of(ScalarShape(keys={"of": ScalarShape(Role.WORKER, "timed")})),
}
DOMAIN_SHAPE = ScalarShape(
    keys={
        "domain": TITLE_SHAPE,
        "use": _USES_SHAPE,
        "without": list_of(STEP),
        "include": list_of(FILE),
        "types": mapping_of(Role.NEW_TYPE, ScalarShape(Role.TYPE, items=NAME)),
        "functions": mapping_of(Role.SIGNATURE, TYPE, "function"),
        "objects": mapping_of(Role.TYPE, list_of(NAME)),
        "statics": mapping_of(Role.SIGNATURE, doing="static"),
        "derived": mapping_of(Role.SIGNATURE, doing="derived predicate"),
        "fluents": mapping_of(Role.SIGNATURE, doing="fluent"),
        "events": mapping_of(Role.SIGNATURE, doing="event"),
        "quantities": mapping_of(Role.SIGNATURE, doing="quantity"),
        "defaults": list_of(GIVEN),
        "operators": mapping_of(Role.HEADER, OPERATOR_SHAPE),
        "deductive_operators": list_of(DEDUCTIVE_SHAPE),
        **TIME_SHAPES,
        "conventions": ScalarShape(other=ScalarShape(Role.PREDICATE, "named")),
        "commands": ScalarShape(
            keys={
                "words": mapping_of(Role.THING, list_of(TEXT_SHAPE)),
                "phrases": list_of(PHRASE_SHAPE),
            }
        ),
    }
)
_EXAMPLE_SHAPES = {"static": GIVEN, "initial": GIVEN, "stage": READ, "goal": READ}
_DEVICE_SECTIONS = {
    key: shape for key, shape in DOMAIN_SHAPE.keys.items() if key not in ("domain", "without")
}
DEVICE_SHAPE = ScalarShape(
    keys={**_DEVICE_SECTIONS, "device": TITLE_SHAPE, "example": ScalarShape(keys=_EXAMPLE_SHAPES)}
)
PROBLEM_SHAPE = ScalarShape(
    keys={
        "problem": TITLE_SHAPE,
        "domain": ScalarShape(Role.DOMAIN),
        "objects": mapping_of(Role.TYPE, list_of(NAME)),
        "statics": list_of(GIVEN),
        "initial": list_of(GIVEN),
        "durations": mapping_of(Role.STEP),
        "goals": list_of(READ),
        "workflow": list_of(
            ScalarShape(
                keys={
                    "name": TITLE_SHAPE,
                    "for": mapping_of(Role.VARIABLE, list_of(THING)),
                    "subject": TERM,
                    "stages": READ,
                }
            )
        ),
        **TIME_SHAPES,
        "command": ScalarShape(Role.SENTENCE),
    }
)
_ACTION_SHAPES = {"preconditions": READ, "by": STEP}
FAULTS_SHAPE = ScalarShape(
    keys={
        "faults": ScalarShape(Role.DOMAIN),
        "exceptions": ScalarShape(
            other=ScalarShape(keys={"of": STEP, "causes": mapping_of(Role.CAUSE)})
        ),
        "causes": mapping_of(
            Role.NEW_CAUSE,
            ScalarShape(
                keys={
                    "doubts": READ,
                    "adds": ADDED,
                    "denies": DENIED,
                    "spoils": DENIED,
                    "loses": list_of(TERM),
                    "blocks": list_of(STEP),
                    "since": list_of(STEP),
                }
            ),
        ),
        "tests": ScalarShape(
            other=ScalarShape(keys={**_ACTION_SHAPES, "gives": mapping_of(Role.CAUSE)})
        ),
        "repairs": ScalarShape(
            other=ScalarShape(
                keys={
                    **_ACTION_SHAPES,
                    "cures": ScalarShape(items=CAUSE, key=Role.CAUSE, other=TEXT_SHAPE),
                    "adds": ADDED,
                    "denies": DENIED,
                    "loses": list_of(TERM),
                }
            )
        ),
    }
)
_FIXED_SHAPE = mapping_of(Role.THING, ScalarShape(keys={"in": THING}), "a body of the cell")
_MOVED_SHAPE = mapping_of(
    Role.THING,
    ScalarShape(keys={"in": THING, "joint": ScalarShape(keys={"follows": THING})}),
    "a body of the cell",
)
_ARMS_SHAPE = mapping_of(
    Role.THING, ScalarShape(keys={"in": THING, "tool": THING}), "a body of the cell"
)
_PLACE_SHAPE = ScalarShape(
    keys={"in": THING, "touches": list_of(THING), "arm": THING, "tool": THING}
)
CELL_SHAPE = ScalarShape(
    keys={
        "cell": TITLE_SHAPE,
        "arms": _ARMS_SHAPE,
        **dict.fromkeys(("frames", "regions", "zones"), _FIXED_SHAPE),
        **dict.fromkeys(("fixtures", "parts", "tools"), _MOVED_SHAPE),
        "allowed_contacts": list_of(list_of(THING)),
        "places": mapping_of(Role.TERMS, _PLACE_SHAPE, "placed"),
        "locations": mapping_of(
            Role.ATOMS, ScalarShape(keys={"body": TERM, "place": TERM, "in": THING}), "read"
        ),
        "operations": mapping_of(
            Role.STEP,
            ScalarShape(
                keys={
                    "at": ScalarShape(Role.TERMS, "named", items=TERM),
                    **dict.fromkeys(("drags", "drives", "with", "carries"), TERM),
                }
            ),
        ),
        "measuring": mapping_of(Role.THING, ScalarShape(keys={"touches": list_of(THING)})),
        "sensors": mapping_of(
            Role.THING,
            ScalarShape(keys={"joint": THING, "force": THING, "load": THING}),
            "a sensor",
        ),
    }
)
CONTACTS_SHAPE = ScalarShape(
    keys={
        "contacts": ScalarShape(Role.DOMAIN),
        "objects": ScalarShape(other=list_of(THING)),
        "permanent": ScalarShape(
            other=ScalarShape(keys={"between": list_of(THING), "by": THING, "fact": READ})
        ),
        "facts": list_of(ScalarShape(keys={"made": ADDED, "broken": ADDED})),
    }
)
SHAPE_OF_KIND: Mapping[str, ScalarShape] = {
    "domain": DOMAIN_SHAPE,
    "device": DEVICE_SHAPE,
    "problem": PROBLEM_SHAPE,
    "faults": FAULTS_SHAPE,
    "cell": CELL_SHAPE,
    "contacts": CONTACTS_SHAPE,
}
"""The shape of each kind of file whose names are indexed; `cellwright.kb.schema` has a form of
the same name.
"""
