"""All names in a domain that have a meaning for the engine.

They say what to measure, and when; there are no others. A domain declares the names that it needs. It may use
another name for each (`conventions` in `domain.yaml`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum

NUMBERS = ("int", "time")


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

    `arguments` are types: `int`, `time` and `text` are those of the language, the others only say what is
    meant. `used_by` are verbs of the command line.
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
        """How a declaration differs from what the engine reads, as a diagnostic code and a text; None if it
        does not differ.
        """
        if sort != self.sort.value:
            return "K108", f"is {WITH_ARTICLE[sort]}, not {WITH_ARTICLE[self.sort.value]}"
        if (given := len(arguments)) != (wanted := len(self.arguments)):
            return "K102", f"has {given} argument{'' if given == 1 else 's'}, not {wanted}"
        for number, pair in enumerate(zip(self.arguments, arguments, strict=True), 1):
            if pair[0] in NUMBERS and pair[1] not in NUMBERS:
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


def _named(sort: Sort, role: str, arguments: str, used_by: str, meaning: str) -> str:
    """A field of `Conventions`. Its default is the role itself; its metadata hold the convention."""
    convention = Convention(role, sort, _listed(arguments), _listed(used_by), meaning)
    made: str = field(default=role, metadata={"convention": convention})
    return made


def _listed(text: str) -> tuple[str, ...]:
    return tuple(text.split(", ")) if text else ()


def _static(role: str, arguments: str, used_by: str, meaning: str) -> str:
    return _named(Sort.STATIC, role, arguments, used_by, meaning)


EVERYWHERE = "sequence, measurement, import"
WRITTEN = "measurement, import"
TOURS = "sequence"
TIMES = "schedule"
WAYS = "plan, sequence, schedule, validate"
POINT = "measurement, int, int, int"


@dataclass(frozen=True, slots=True)
class Conventions:
    """The name that a domain gives to each convention."""

    measurement: str = _named(
        Sort.TYPE, "measurement", "", EVERYWHERE, "what is measured: each object of this type is one visit"
    )
    meas: str = _named(
        Sort.FUNCTION, "meas", "measurement", EVERYWHERE, "the place of a measurement, also in `cell.yaml`"
    )
    profile: str = _named(Sort.CONSTANT, "profile", "", WRITTEN, "a kind of measurement: where a surface is")
    thickness: str = _named(
        Sort.CONSTANT, "thickness", "", WRITTEN, "a kind of measurement: how thick a wall is"
    )
    needs: str = _static("needs", "measurement, kind", WRITTEN, "of what kind a measurement is")
    position: str = _static("position", POINT, EVERYWHERE, "where a measurement is: x, y, z in micrometres")
    normal: str = _static(
        "normal",
        POINT,
        WRITTEN,
        "the direction away from the material at a measurement: x, y, z in thousandths; `0, 0, -1000` if none is given",
    )
    tolerance: str = _static(
        "tolerance",
        "measurement, int",
        WRITTEN,
        "how wide the tolerance zone of a measurement is, in micrometres",
    )
    nominal: str = _static(
        "nominal", "measurement, int", WRITTEN, "what a measurement should give, in micrometres"
    )
    bore: str = _static(
        "bore", "measurement, int", WRITTEN, "how wide the hole is that a measurement lies in, in micrometres"
    )
    prefers: str = _static(
        "prefers", "measurement, tool", WRITTEN, "a tool that is to take a measurement if it can"
    )
    alignment: str = _static(
        "alignment",
        "measurement, int",
        "sequence, import",
        "in which step of the alignment a measurement is made: 1 first; all of them come before the others",
    )
    aligned_within: str = _static(
        "aligned_within",
        "int",
        "run",
        "how well every measured point of the part has to be known once it is aligned: two standard deviations, in micrometres",
    )
    impossible: str = _static(
        "impossible", "measurement, text", EVERYWHERE, "why no tool can take a measurement"
    )
    chosen: str = _static("chosen", "tool, measurement", EVERYWHERE, "which tool takes a measurement")
    refused: str = _static(
        "refused", "tool, measurement, text", EVERYWHERE, "why a tool for its kind cannot take a measurement"
    )
    unavailable: str = _static("unavailable", "tool", TOURS, "a tool was lost; the engine adds these facts")
    window: str = _static(
        "window",
        "measurement, time, time",
        TOURS,
        "the earliest and the latest time at which a measurement may begin, from the start of the tour",
    )
    lasts: str = _static("lasts", "measurement, time", TOURS, "how long a measurement takes in a tour")
    before: str = _static(
        "before", "measurement, measurement", TOURS, "the first measurement is made before the second"
    )
    serves: str = _static(
        "serves",
        "station, measurement",
        TOURS,
        "from where the arm reaches a measurement; from everywhere if none is given",
    )
    shift: str = _static(
        "shift",
        "station, station, int",
        TOURS,
        "what going to another station costs, as a way in micrometres",
    )
    within_reach: str = _static(
        "within_reach",
        "arm, measurement",
        TOURS,
        "an arm that reaches a measurement; if nothing is said of one, the cell decides, and without a cell every arm does",
    )
    equips: str = _static(
        "equips",
        "tool, arm",
        TOURS,
        "the arm that a tool is for; if nothing is said of a tool, one of several arms is chosen for it",
    )
    change: str = _static(
        "change", "tool, tool, int", TOURS, "what a change of tools costs, as a way in micrometres"
    )
    measured: str = _named(
        Sort.FLUENT,
        "measured",
        "tool, arm, place",
        EVERYWHERE,
        "a measurement is done; operators that add it are those that measure",
    )
    travel: str = _static(
        "travel", "place, place, time", WAYS, "how long the arm travels empty from one place to another"
    )
    longest_stay: str = _static("longest_stay", "place, time", TIMES, "how long anything may stay in a place")
    release: str = _static("release", "object, time", TIMES, "when the job of an object may start")
    due: str = _static("due", "object, time", TIMES, "when the job of an object should have ended")
    priority: str = _static(
        "priority", "object, int", TIMES, "what each unit of time costs by which the job of an object is late"
    )

    def kind(self, word: str) -> str:
        """The domain's name for a kind of measurement. The domain's own kinds keep their names."""
        return {"profile": self.profile, "thickness": self.thickness}.get(word, word)

    def place(self, measurement: str) -> str:
        """The text of the term for the place of a measurement."""
        return f"{self.meas}({measurement})"


CONVENTIONS: Mapping[str, Convention] = {
    each.name: each.metadata["convention"] for each in fields(Conventions)
}
