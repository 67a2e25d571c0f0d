"""The names of a domain by which the engine knows what to measure, and when: those written here, and no others.

A domain declares those that it needs, and may call each by another name (`conventions` in `domain.yaml`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum

NUMBERS = ("int", "time")


class Sort(Enum):
    """What a name is the name of."""

    TYPE = "type"
    CONSTANT = "constant"
    FUNCTION = "function"
    STATIC = "static"
    FLUENT = "fluent"


@dataclass(frozen=True, slots=True)
class Convention:
    """What the engine reads or writes under the name `role`, where the domain does not rename it.

    `arguments` are types: `int`, `time` and `text` are those of the language, the others say what is meant. `used_by`
    are verbs of the command line.
    """

    role: str
    sort: Sort
    arguments: tuple[str, ...]
    used_by: tuple[str, ...]
    meaning: str

    @property
    def is_about_time(self) -> bool:
        """Whether schedules read it; all others are about measurements."""
        return "schedule" in self.used_by

    def written(self, name: str = "") -> str:
        """How it is declared, under its own name or under another one."""
        brackets = f"({', '.join(self.arguments)})" if self.arguments else ""
        return f"{name or self.role}{brackets}"


def _named(sort: Sort, role: str, arguments: str, used_by: str, meaning: str) -> str:
    """A field that is called by its role where nothing else is given; its metadata tell what it is."""
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
POINT = "measurement, int, int, int"


@dataclass(frozen=True, slots=True)
class Conventions:
    """What a domain calls each convention."""

    measurement: str = _named(
        Sort.TYPE, "measurement", "", EVERYWHERE, "what is measured: each object is one visit"
    )
    meas: str = _named(
        Sort.FUNCTION, "meas", "measurement", EVERYWHERE, "the place of a measurement, also in the cell"
    )
    profile: str = _named(
        Sort.CONSTANT, "profile", "", WRITTEN, "a kind of measurement: where the surface is"
    )
    thickness: str = _named(
        Sort.CONSTANT, "thickness", "", WRITTEN, "a kind of measurement: how thick the material is"
    )
    needs: str = _static("needs", "measurement, kind", WRITTEN, "the kind of the measurement")
    position: str = _static("position", POINT, EVERYWHERE, "where it is: x, y, z in micrometres")
    normal: str = _static("normal", POINT, WRITTEN, "away from the material: x, y, z in thousandths")
    tolerance: str = _static(
        "tolerance", "measurement, int", WRITTEN, "the width of the zone that is to be shown, in micrometres"
    )
    bore: str = _static(
        "bore", "measurement, int", WRITTEN, "the width of the hole that it lies in, in micrometres"
    )
    impossible: str = _static("impossible", "measurement, text", EVERYWHERE, "why nothing can measure it")
    chosen: str = _static("chosen", "tool, measurement", EVERYWHERE, "the tool that takes it")
    refused: str = _static(
        "refused", "tool, measurement, text", EVERYWHERE, "why a tool for this kind cannot take it"
    )
    unavailable: str = _static("unavailable", "tool", TOURS, "the tool was lost")
    change: str = _static(
        "change", "tool, tool, int", TOURS, "what a change of tools costs, as a way in micrometres"
    )
    measured: str = _named(
        Sort.FLUENT, "measured", "tool, arm, place", EVERYWHERE, "it is done; operators that add it measure"
    )
    travel: str = _static(
        "travel", "place, place, time", TIMES, "how long the arm travels empty from one place to the other"
    )
    longest_stay: str = _static("longest_stay", "place, time", TIMES, "nothing stays longer in the place")
    release: str = _static("release", "object, time", TIMES, "its job does not start before")
    due: str = _static("due", "object, time", TIMES, "when its job should have ended")
    priority: str = _static("priority", "object, int", TIMES, "what each unit of time after that costs")

    def kind(self, word: str) -> str:
        """What the domain calls a kind of measurement; kinds of its own are called as they are."""
        return {"profile": self.profile, "thickness": self.thickness}.get(word, word)

    def place(self, measurement: str) -> str:
        """The place of a measurement, as the term is written."""
        return f"{self.meas}({measurement})"


CONVENTIONS: Mapping[str, Convention] = {
    each.name: each.metadata["convention"] for each in fields(Conventions)
}
