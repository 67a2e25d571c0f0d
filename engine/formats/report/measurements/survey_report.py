"""Survey of a part: features with their verdicts, as text, as data and as one HTML file."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.verdicts import MeasuredFeature, Survey
from cellwright.kb.model.measured_results import Results

# verdicts that are listed one by one
NOTED_VERDICTS = ("not conforming", "undecided", "doubtful", "failed")
MAX_SURVEY_ROWS = 40
REPEATED_HEAD = ("measured again", "because", "values that count", "so it is")


def survey_entry(survey: Survey) -> dict[str, Any]:
    """A survey as plain values."""
    return {
        "features": [_feature_entry(feature) for feature in survey.features],
        "not_measured": [
            {"name": missing.name, "why": missing.why} for missing in survey.unmeasured
        ],
        "verdicts": survey.counts(),
        "part": list(survey.part),
        "wrong_datums": list(survey.wrong),
        "part_refused": survey.refused,
    }


def _feature_entry(feature: MeasuredFeature) -> dict[str, Any]:
    names = (
        "of",
        "quantity",
        "unit",
        "nominal",
        "lower",
        "upper",
        "risk",
        "value",
        "uncertainty",
        "doubt",
    )
    bad = [
        {"value": bad_value.value, "tool": bad_value.tool, "at_ms": bad_value.at_ms, "why": why}
        for bad_value, why in feature.bad
    ]
    return {name: getattr(feature, name) for name in names} | {
        "verdict": feature.judged,
        "values": len(feature.values),
        "decided_by": [
            {"value": value.value, "tool": value.tool, "uncertainty": value.uncertainty}
            for value in feature.values
        ],
        "again": list(feature.again),
        "bad": bad,
    }


def survey_text(survey: Survey) -> RenderableType:
    """A survey for a terminal."""
    return Group(*_survey_parts(survey))


def _survey_parts(survey: Survey) -> Iterator[RenderableType]:
    yield Text(survey_summary(survey))
    if alignment_text := alignment_sentence(survey):
        yield Text(alignment_text)
    rows = [
        _feature_row(feature) for feature in survey.features if feature.judged in NOTED_VERDICTS
    ]
    if rows:
        yield TextTable(
            ("feature", "quantity", "value", "from", "to", "verdict", ""), rows[:MAX_SURVEY_ROWS]
        )
        yield from _more_line(len(rows))
    again = repeated_rows(survey)
    if again:
        yield TextTable(REPEATED_HEAD, again[:MAX_SURVEY_ROWS])
        yield from _more_line(len(again))
    bad = [
        (bad_value.of, _value_text(bad_value.value, bad_value.unit), why)
        for feature in survey.features
        for bad_value, why in feature.bad
    ]
    if bad:
        yield TextTable(("left out", "value", "because"), bad[:MAX_SURVEY_ROWS])
        yield from _more_line(len(bad))
    if survey.unmeasured:
        yield TextTable(
            ("not measured", "because"),
            [(missing.name, missing.why) for missing in survey.unmeasured[:MAX_SURVEY_ROWS]],
        )
        yield from _more_line(len(survey.unmeasured))


def repeated_rows(survey: Survey) -> list[tuple[str, ...]]:
    """What was measured again, a row for each feature: its name, why, the values that count
    with their tools, the verdict.
    """
    return [_repeated_row(feature) for feature in survey.features if feature.again]


def _repeated_row(feature: MeasuredFeature) -> tuple[str, ...]:
    times = (
        ""
        if len(feature.again) == 1
        else f" ({len(feature.again)} times; this was the last reason)"
    )
    return feature.of, feature.again[-1] + times, by_tools(feature), feature.judged


def by_tools(feature: MeasuredFeature) -> str:
    """The values of a feature that count, each with its tool."""
    return ", ".join(
        f"{_value_text(value.value, value.unit)} by {value.tool}" for value in feature.values
    )


def _more_line(count: int) -> Iterator[RenderableType]:
    if count > MAX_SURVEY_ROWS:
        yield Text(
            f"... and {count - MAX_SURVEY_ROWS} more: --format json and the report in HTML list all"
        )


def survey_summary(survey: Survey) -> str:
    """How many features there are of each verdict."""
    counts_text = ", ".join(f"{count} {name}" for name, count in survey.counts().items())
    bad = sum(len(feature.bad) for feature in survey.features)
    bad_text = f"; {count_noun(bad, 'bad value')} left out" if bad else ""
    return (
        f"{count_noun(len(survey.features) + len(survey.unmeasured), 'feature')}: "
        f"{counts_text}{bad_text}"
    )


def alignment_sentence(survey: Survey) -> str:
    """Where the part lay, in a sentence; empty if it was not looked for."""
    if survey.refused:
        return f"the part was not found: {survey.refused}"
    if not survey.part:
        return ""
    shift = ", ".join(f"{1e3 * survey.part[n]:.3f}" for n in (3, 7, 11))
    wrong_text = f"; wrong: {', '.join(survey.wrong)}" if survey.wrong else ""
    return (
        f"the part lay ({shift}) mm beside its model, by "
        f"{count_noun(survey.datums, 'datum')}{wrong_text}"
    )


def _feature_row(feature: MeasuredFeature) -> tuple[str, ...]:
    limits = tuple(
        "" if value is None else f"{value:g}" for value in (feature.lower, feature.upper)
    )
    return (
        feature.of,
        feature.quantity,
        feature_value(feature),
        *limits,
        feature.judged,
        feature.doubt,
    )


def feature_value(feature: MeasuredFeature) -> str:
    """The value of a feature with its expanded uncertainty."""
    if feature.value is None:
        return ""
    sure = "" if feature.uncertainty is None else f" ± {feature.uncertainty:.3g}"
    return f"{_value_text(feature.value, '')}{sure} {feature.unit}".strip()


def _value_text(value: float, unit: str) -> str:
    return (f"{value:.6g}" if abs(value) < 1e5 else f"{value:.0f}") + (f" {unit}" if unit else "")


VERDICT_COLOURS = {
    "conforming": "#2a9d5c", "passed": "#2a9d5c", "not conforming": "#d1382f", "failed": "#d1382f",
    "undecided": "#e0a100", "doubtful": "#8e44ad", "not "
    "judged": "#4a7ab5", "not measured": "#999999",
}  # fmt: skip
PART_VIEWS = (("x", "y", 0, 1), ("x", "z", 0, 2), ("y", "z", 1, 2))
WIDTH, MARGIN, LEAST = 860.0, 30.0, 40.0
SURVEY_STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:62em;padding:0 1em;color:#222;background:#fff}
table{border-collapse:collapse;margin:.6em 0 1.6em;width:100%}
th,td{text-align:left;padding:.2em .7em .2em 0;border-bottom:1px solid #ddd;vertical-align:top}
td.n{text-align:right;font-variant-numeric:tabular-nums}
svg{max-width:100%;height:auto;border:1px solid #ddd}
.v{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.4em}
"""


@dataclass(frozen=True, slots=True)
class _FeatureDot:
    """A feature in a picture: where it is (m), its verdict, and what is told of it."""

    at: tuple[float, float]
    verdict: str
    told: str


def survey_html(results: Results, survey: Survey) -> str:
    """The report of a run. Every text in it is escaped, and nothing in it is fetched from
    elsewhere.
    """
    name = escape(results.run)
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f"<title>Inspection {name}</title><style>{SURVEY_STYLE}</style></head><body>",
            f"<h1>Inspection {name}</h1>",
            f"<p>{escape(results.started)}</p><p>{escape(survey_summary(survey))}</p>",
            *(
                [f"<p>{escape(alignment_text)}</p>"]
                if (alignment_text := alignment_sentence(survey))
                else []
            ),
            *_verdict_legend(survey),
            *_part_pictures(survey),
            *_features_html(survey),
            *_repeated_html(survey),
            *_left_out(survey),
            *_unmeasured_html(survey),
            "</body></html>",
            "",
        ]
    )


def _verdict_dot(verdict: str) -> str:
    return f'<span class="v" style="background:{VERDICT_COLOURS.get(verdict, "#000000")}"></span>'


def _verdict_legend(survey: Survey) -> Iterator[str]:
    legend_entries = (
        f"{_verdict_dot(name)}{escape(name)}: {count}" for name, count in survey.counts().items()
    )
    yield f"<p>{' &nbsp; '.join(legend_entries)}</p>"


def _part_pictures(survey: Survey) -> Iterator[str]:
    """The features seen along each axis of the part, as far as they lie apart there."""
    verdicts = [(feature.of, feature.judged, feature_value(feature)) for feature in survey.features]
    verdicts += [(missing.name, "not measured", missing.why) for missing in survey.unmeasured]
    for across, up, u, v in PART_VIEWS:
        dots = [
            _FeatureDot(
                (survey.places[name][u], survey.places[name][v]),
                verdict,
                f"{name}: {verdict}, {dot_note}",
            )
            for name, verdict, dot_note in verdicts
            if name in survey.places
        ]
        spans = [_dots_span(dots, axis) for axis in (0, 1)]
        if min(spans) > 0.02 * max(spans):
            yield f"<h2>Seen in {across} and {up}</h2>"
            yield _part_picture(dots)


def _dots_span(dots: Sequence[_FeatureDot], axis: int) -> float:
    along = [dot.at[axis] for dot in dots]
    return max(along, default=0.0) - min(along, default=0.0)


def _part_picture(dots: Sequence[_FeatureDot]) -> str:
    """The longer side of the part goes across; what is good is drawn first, so that it hides
    nothing.
    """
    wide, tall = (0, 1) if _dots_span(dots, 0) >= _dots_span(dots, 1) else (1, 0)
    low = [min(dot.at[axis] for dot in dots) for axis in (0, 1)]
    scale = (WIDTH - 2 * MARGIN) / _dots_span(dots, wide)
    height = max(LEAST, scale * _dots_span(dots, tall)) + 2 * MARGIN
    drawn, order = [], list(VERDICT_COLOURS)
    for dot_entry in sorted(
        dots,
        key=lambda shown_dot: (
            order.index(shown_dot.verdict) if shown_dot.verdict in VERDICT_COLOURS else 0
        ),
    ):
        x = MARGIN + scale * (dot_entry.at[wide] - low[wide])
        y = height - MARGIN - scale * (dot_entry.at[tall] - low[tall])
        colour, dot_text = VERDICT_COLOURS.get(dot_entry.verdict, "#000000"), escape(dot_entry.told)
        drawn.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" '
            f'fill="{colour}"><title>{dot_text}</title></circle>'
        )
    box = f"0 0 {WIDTH:.0f} {height:.0f}"
    return f'<svg viewBox="{box}" width="{WIDTH:.0f}" role="img">{"".join(drawn)}</svg>'


def _features_html(survey: Survey) -> Iterator[str]:
    yield "<h2>Features</h2>"
    head = ("feature", "quantity", "value", "nominal", "from", "to", "values", "verdict", "")
    yield _html_table(head, (_feature_html_row(feature) for feature in survey.features))


def _feature_html_row(feature: MeasuredFeature) -> tuple[str, ...]:
    numbers = (
        "" if value is None else f"{value:g}"
        for value in (feature.nominal, feature.lower, feature.upper)
    )
    cells = (
        feature.of,
        feature.quantity,
        feature_value(feature),
        *numbers,
        str(len(feature.values)),
    )
    return (
        *map(escape, cells),
        _verdict_dot(feature.judged) + escape(feature.judged),
        escape(feature.doubt),
    )


def _repeated_html(survey: Survey) -> Iterator[str]:
    if rows := repeated_rows(survey):
        yield "<h2>Measured again</h2>"
        yield _html_table(
            ("feature", *REPEATED_HEAD[1:]), (tuple(map(escape, row)) for row in rows)
        )


def _left_out(survey: Survey) -> Iterator[str]:
    rows = [
        tuple(
            map(
                escape,
                (
                    bad_value.of,
                    f"{bad_value.value:g} {bad_value.unit}",
                    bad_value.tool,
                    f"{bad_value.at_ms / 1000:.1f} s",
                    why,
                ),
            )
        )
        for feature in survey.features
        for bad_value, why in feature.bad
    ]
    if rows:
        yield "<h2>Values left out</h2>"
        yield _html_table(("feature", "value", "by", "at", "because"), rows)


def _unmeasured_html(survey: Survey) -> Iterator[str]:
    if survey.unmeasured:
        yield "<h2>Not measured</h2>"
        yield _html_table(
            ("measurement", "because"),
            ((escape(missing.name), escape(missing.why)) for missing in survey.unmeasured),
        )


def _html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the cells are escaped already."""
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"
