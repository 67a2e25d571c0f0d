"""What a run has shown of a part: its features with their verdicts, what was left out and why, where the part lay."""

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.engine.model.verdicts import Feature, Survey
from cellwright.engine.model.wording import counted

NOTED = ("not conforming", "undecided", "doubtful", "failed")  # verdicts that are listed one by one
MANY = 40
AGAIN = ("measured again", "because", "values that count", "so it is")


def entry(survey: Survey) -> dict[str, Any]:
    """A survey as plain values."""
    return {
        "features": [_entry(each) for each in survey.features],
        "not_measured": [{"name": each.name, "why": each.why} for each in survey.unmeasured],
        "verdicts": survey.counts(),
        "part": list(survey.part),
        "wrong_datums": list(survey.wrong),
        "part_refused": survey.refused,
    }


def _entry(each: Feature) -> dict[str, Any]:
    names = ("of", "quantity", "unit", "nominal", "lower", "upper", "risk", "value", "uncertainty", "doubt")
    bad = [{"value": one.value, "tool": one.tool, "at_ms": one.at_ms, "why": why} for one, why in each.bad]
    return {name: getattr(each, name) for name in names} | {
        "verdict": each.judged,
        "values": len(each.values),
        "decided_by": [
            {"value": one.value, "tool": one.tool, "uncertainty": one.uncertainty} for one in each.values
        ],
        "again": list(each.again),
        "bad": bad,
    }


def text(survey: Survey) -> RenderableType:
    """A survey for a terminal."""
    return Group(*_parts(survey))


def _parts(survey: Survey) -> Iterator[RenderableType]:
    yield Text(summary(survey))
    if said := lying(survey):
        yield Text(said)
    rows = [_row(each) for each in survey.features if each.judged in NOTED]
    if rows:
        yield TextTable(("feature", "quantity", "value", "from", "to", "verdict", ""), rows[:MANY])
        yield from _more(len(rows))
    again = repeated(survey)
    if again:
        yield TextTable(AGAIN, again[:MANY])
        yield from _more(len(again))
    bad = [(one.of, _number(one.value, one.unit), why) for each in survey.features for one, why in each.bad]
    if bad:
        yield TextTable(("left out", "value", "because"), bad[:MANY])
        yield from _more(len(bad))
    if survey.unmeasured:
        yield TextTable(
            ("not measured", "because"), [(each.name, each.why) for each in survey.unmeasured[:MANY]]
        )
        yield from _more(len(survey.unmeasured))


def repeated(survey: Survey) -> list[tuple[str, ...]]:
    """What was measured again, a row for each feature: its name, why, the values that count with their tools, the verdict."""
    return [_repeated(each) for each in survey.features if each.again]


def _repeated(each: Feature) -> tuple[str, ...]:
    times = "" if len(each.again) == 1 else f" ({len(each.again)} times; this was the last reason)"
    return each.of, each.again[-1] + times, by_tools(each), each.judged


def by_tools(each: Feature) -> str:
    """The values of a feature that count, each with its tool."""
    return ", ".join(f"{_number(one.value, one.unit)} by {one.tool}" for one in each.values)


def _more(count: int) -> Iterator[RenderableType]:
    if count > MANY:
        yield Text(f"... and {count - MANY} more: --format json and the report in HTML list all")


def summary(survey: Survey) -> str:
    """How many features there are of each verdict."""
    said = ", ".join(f"{count} {name}" for name, count in survey.counts().items())
    bad = sum(len(each.bad) for each in survey.features)
    told = f"; {counted(bad, 'bad value')} left out" if bad else ""
    return f"{counted(len(survey.features) + len(survey.unmeasured), 'feature')}: {said}{told}"


def lying(survey: Survey) -> str:
    """Where the part lay, in a sentence; empty if it was not looked for."""
    if survey.refused:
        return f"the part was not found: {survey.refused}"
    if not survey.part:
        return ""
    shift = ", ".join(f"{1e3 * survey.part[n]:.3f}" for n in (3, 7, 11))
    told = f"; wrong: {', '.join(survey.wrong)}" if survey.wrong else ""
    return f"the part lay ({shift}) mm beside its model, by {counted(survey.datums, 'datum')}{told}"


def _row(each: Feature) -> tuple[str, ...]:
    limits = tuple("" if value is None else f"{value:g}" for value in (each.lower, each.upper))
    return (each.of, each.quantity, shown(each), *limits, each.judged, each.doubt)


def shown(each: Feature) -> str:
    """The value of a feature with its expanded uncertainty."""
    if each.value is None:
        return ""
    sure = "" if each.uncertainty is None else f" ± {each.uncertainty:.3g}"
    return f"{_number(each.value, '')}{sure} {each.unit}".strip()


def _number(value: float, unit: str) -> str:
    return (f"{value:.6g}" if abs(value) < 1e5 else f"{value:.0f}") + (f" {unit}" if unit else "")
