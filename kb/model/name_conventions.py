"""The names in a domain that have a meaning for the engine, and what each means.

They say what to measure, and when; there are no others. A domain declares the names that it needs.
It may use another name for each (`conventions` in `domain.yaml`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum

NUMBER_SORTS = ("int", "time")


class Sort(Enum):
    """The kind of thing that a name stands for."""

    TYPE = "type"
    CONSTANT = "constant"
    FUNCTION = "function"
    STATIC = "static"
    FLUENT = "fluent"


@dataclass(frozen=True, slots=True)
class Convention:
    """A name that the engine reads or writes. It is `role`, unless the domain renames it.

    `arguments` are types: `int`, `time` and `text` are those of the language, the others only say
    what is meant. `used_by` are verbs of the command line.
    """

    role: str
    sort: Sort
    arguments: tuple[str, ...]
    used_by: tuple[str, ...]
    meaning: str

    @property
    def is_about_time(self) -> bool:
        """Whether schedules read it. All other conventions are about measurements."""
        return "schedule" in self.used_by

    def written(self, name: str = "") -> str:
        """The text of its declaration, with its own name or with another one."""
        brackets = f"({', '.join(self.arguments)})" if self.arguments else ""
        return f"{name or self.role}{brackets}"

    def deviation(self, sort: str, arguments: Sequence[str]) -> tuple[str, str] | None:
        """How a declaration differs from what the engine reads, as a diagnostic code and a text;
        None if it does not differ.
        """
        if sort != self.sort.value:
            return "K108", f"is {WITH_ARTICLE[sort]}, not {WITH_ARTICLE[self.sort.value]}"
        if (given := len(arguments)) != (wanted := len(self.arguments)):
            return "K102", f"has {given} argument{'' if given == 1 else 's'}, not {wanted}"
        for number, pair in enumerate(zip(self.arguments, arguments, strict=True), 1):
            if pair[0] in NUMBER_SORTS and pair[1] not in NUMBER_SORTS:
                return "K103", f"has no number as argument {number}"
        return None


WITH_ARTICLE = {
    "type": "a type",
    "constant": "a constant",
    "function": "a function",
    "static": "a static predicate",
    "fluent": "a fluent",
    "derived": "a predicate derived from fluents",
    "event": "an event",
}


def _named_field(sort: Sort, role: str, arguments: str, used_by: str, meaning: str) -> str:
    """A field of `Conventions`.

    Its default is the role itself; its metadata hold the convention.
    """
    convention = Convention(role, sort, _split_names(arguments), _split_names(used_by), meaning)
    made: str = field(default=role, metadata={"convention": convention})
    return made


def _split_names(text: str) -> tuple[str, ...]:
    return tuple(text.split(", ")) if text else ()


def _static_field(role: str, arguments: str, used_by: str, meaning: str) -> str:
    return _named_field(Sort.STATIC, role, arguments, used_by, meaning)


ALL_USERS = "sequence, measurement, import"
IMPORT_USERS = "measurement, import"
TOUR_USERS = "sequence"
TIME_USERS = "schedule"
PLAN_USERS = "plan, sequence, schedule, validate"
POINT_ARGUMENTS = "measurement, int, int, int"


@dataclass(frozen=True, slots=True)
class Conventions:
    """The name that a domain gives to each convention."""

    measurement: str = _named_field(
        Sort.TYPE,
        "measurement",
        "",
        ALL_USERS,
        "what is measured: each object of this type is one visit",
    )
    meas: str = _named_field(
        Sort.FUNCTION,
        "meas",
        "measurement",
        ALL_USERS,
        "the place of a measurement, also in `cell.yaml`",
    )
    profile: str = _named_field(
        Sort.CONSTANT, "profile", "", IMPORT_USERS, "a kind of measurement: where a surface is"
    )
    thickness: str = _named_field(
        Sort.CONSTANT, "thickness", "", IMPORT_USERS, "a kind of measurement: how thick a wall is"
    )
    needs: str = _static_field(
        "needs", "measurement, kind", IMPORT_USERS, "of what kind a measurement is"
    )
    position: str = _static_field(
        "position", POINT_ARGUMENTS, ALL_USERS, "where a measurement is: x, y, z in micrometres"
    )
    normal: str = _static_field(
        "normal",
        POINT_ARGUMENTS,
        IMPORT_USERS,
        "the direction away from the material at a measurement: x, y, z in thousandths; `0, 0, "
        "-1000` if none is given",
    )
    tolerance: str = _static_field(
        "tolerance",
        "measurement, int",
        IMPORT_USERS,
        "how wide the tolerance zone of a measurement is, in micrometres",
    )
    nominal: str = _static_field(
        "nominal",
        "measurement, int",
        IMPORT_USERS,
        "what a measurement should give, in micrometres",
    )
    bore: str = _static_field(
        "bore",
        "measurement, int",
        IMPORT_USERS,
        "how wide the hole is that a measurement lies in, in micrometres",
    )
    prefers: str = _static_field(
        "prefers",
        "measurement, tool",
        IMPORT_USERS,
        "a tool that is to take a measurement if it can",
    )
    alignment: str = _static_field(
        "alignment",
        "measurement, int",
        "sequence, import",
        "in which step of the alignment a measurement is made: 1 first; all of them come before "
        "the others",
    )
    aligned_within: str = _static_field(
        "aligned_within",
        "int",
        "run",
        "how well every measured point of the part has to be known once it is aligned: two "
        "standard deviations, in micrometres",
    )
    impossible: str = _static_field(
        "impossible", "measurement, text", ALL_USERS, "why no tool can take a measurement"
    )
    chosen: str = _static_field(
        "chosen", "tool, measurement", ALL_USERS, "which tool takes a measurement"
    )
    refused: str = _static_field(
        "refused",
        "tool, measurement, text",
        ALL_USERS,
        "why a tool for its kind cannot take a measurement",
    )
    unavailable: str = _static_field(
        "unavailable", "tool", TOUR_USERS, "a tool was lost; the engine adds these facts"
    )
    window: str = _static_field(
        "window",
        "measurement, time, time",
        TOUR_USERS,
        "the earliest and the latest time at which a measurement may begin, from the start of "
        "the tour",
    )
    lasts: str = _static_field(
        "lasts", "measurement, time", TOUR_USERS, "how long a measurement takes in a tour"
    )
    before: str = _static_field(
        "before",
        "measurement, measurement",
        TOUR_USERS,
        "the first measurement is made before the second",
    )
    serves: str = _static_field(
        "serves",
        "station, measurement",
        TOUR_USERS,
        "from where the arm reaches a measurement; from everywhere if none is given",
    )
    shift: str = _static_field(
        "shift",
        "station, station, int",
        TOUR_USERS,
        "what going to another station costs, as a way in micrometres",
    )
    within_reach: str = _static_field(
        "within_reach",
        "arm, measurement",
        TOUR_USERS,
        "an arm that reaches a measurement; if nothing is said of one, the cell decides, and "
        "without a cell every arm does",
    )
    equips: str = _static_field(
        "equips",
        "tool, arm",
        TOUR_USERS,
        "the arm that a tool is for; if nothing is said of a tool, one of several arms is "
        "chosen for it",
    )
    change: str = _static_field(
        "change",
        "tool, tool, int",
        TOUR_USERS,
        "what a change of tools costs, as a way in micrometres",
    )
    measured: str = _named_field(
        Sort.FLUENT,
        "measured",
        "tool, arm, place",
        ALL_USERS,
        "a measurement is done; operators that add it are those that measure",
    )
    travel: str = _static_field(
        "travel",
        "place, place, time",
        PLAN_USERS,
        "how long the arm travels empty from one place to another",
    )
    longest_stay: str = _static_field(
        "longest_stay", "place, time", TIME_USERS, "how long anything may stay in a place"
    )
    release: str = _static_field(
        "release", "object, time", TIME_USERS, "when the job of an object may start"
    )
    due: str = _static_field(
        "due", "object, time", TIME_USERS, "when the job of an object should have ended"
    )
    priority: str = _static_field(
        "priority",
        "object, int",
        TIME_USERS,
        "what each unit of time costs by which the job of an object is late",
    )

    def kind(self, word: str) -> str:
        """The domain's name for a kind of measurement. The domain's own kinds keep their names."""
        return {"profile": self.profile, "thickness": self.thickness}.get(word, word)

    def place(self, measurement: str) -> str:
        """The text of the term for the place of a measurement."""
        return f"{self.meas}({measurement})"


CONVENTION_BY_NAME: Mapping[str, Convention] = {
    convention_field.name: convention_field.metadata["convention"]
    for convention_field in fields(Conventions)
}
