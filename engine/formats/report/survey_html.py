"""A survey as one HTML file that needs nothing else: pictures of the part with its features, and tables of all that is known."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from cellwright.engine.formats.report.survey import AGAIN, lying, repeated, shown, summary
from cellwright.engine.model.verdicts import Feature, Survey
from cellwright.kb.model.results import Results

COLOURS = {
    "conforming": "#2a9d5c", "passed": "#2a9d5c", "not conforming": "#d1382f", "failed": "#d1382f",
    "undecided": "#e0a100", "doubtful": "#8e44ad", "not judged": "#4a7ab5", "not measured": "#999999",
}  # fmt: skip
SIDES = (("x", "y", 0, 1), ("x", "z", 0, 2), ("y", "z", 1, 2))
WIDTH, MARGIN, LEAST = 860.0, 30.0, 40.0
STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:62em;padding:0 1em;color:#222;background:#fff}
table{border-collapse:collapse;margin:.6em 0 1.6em;width:100%}
th,td{text-align:left;padding:.2em .7em .2em 0;border-bottom:1px solid #ddd;vertical-align:top}
td.n{text-align:right;font-variant-numeric:tabular-nums}
svg{max-width:100%;height:auto;border:1px solid #ddd}
.v{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.4em}
"""


@dataclass(frozen=True, slots=True)
class _Dot:
    """A feature in a picture: where it is (m), its verdict, and what is told of it."""

    at: tuple[float, float]
    verdict: str
    told: str


def document(results: Results, survey: Survey) -> str:
    """The report of a run. Every text in it is escaped, and nothing in it is fetched from elsewhere."""
    name = escape(results.run)
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f"<title>Inspection {name}</title><style>{STYLE}</style></head><body>",
            f"<h1>Inspection {name}</h1>",
            f"<p>{escape(results.started)}</p><p>{escape(summary(survey))}</p>",
            *([f"<p>{escape(said)}</p>"] if (said := lying(survey)) else []),
            *_legend(survey),
            *_pictures(survey),
            *_features(survey),
            *_again(survey),
            *_left_out(survey),
            *_unmeasured(survey),
            "</body></html>",
            "",
        ]
    )


def _dot(verdict: str) -> str:
    return f'<span class="v" style="background:{COLOURS.get(verdict, "#000000")}"></span>'


def _legend(survey: Survey) -> Iterator[str]:
    said = (f"{_dot(name)}{escape(name)}: {count}" for name, count in survey.counts().items())
    yield f"<p>{' &nbsp; '.join(said)}</p>"


def _pictures(survey: Survey) -> Iterator[str]:
    """The features seen along each axis of the part, as far as they lie apart there."""
    verdicts = [(each.of, each.judged, shown(each)) for each in survey.features]
    verdicts += [(each.name, "not measured", each.why) for each in survey.unmeasured]
    for across, up, u, v in SIDES:
        dots = [
            _Dot((survey.places[name][u], survey.places[name][v]), verdict, f"{name}: {verdict}, {told}")
            for name, verdict, told in verdicts
            if name in survey.places
        ]
        spans = [_span(dots, axis) for axis in (0, 1)]
        if min(spans) > 0.02 * max(spans):
            yield f"<h2>Seen in {across} and {up}</h2>"
            yield _picture(dots)


def _span(dots: Sequence[_Dot], axis: int) -> float:
    along = [each.at[axis] for each in dots]
    return max(along, default=0.0) - min(along, default=0.0)


def _picture(dots: Sequence[_Dot]) -> str:
    """The longer side of the part goes across; what is good is drawn first, so that it hides nothing."""
    wide, tall = (0, 1) if _span(dots, 0) >= _span(dots, 1) else (1, 0)
    low = [min(each.at[axis] for each in dots) for axis in (0, 1)]
    scale = (WIDTH - 2 * MARGIN) / _span(dots, wide)
    height = max(LEAST, scale * _span(dots, tall)) + 2 * MARGIN
    drawn, order = [], list(COLOURS)
    for each in sorted(dots, key=lambda one: order.index(one.verdict) if one.verdict in COLOURS else 0):
        x = MARGIN + scale * (each.at[wide] - low[wide])
        y = height - MARGIN - scale * (each.at[tall] - low[tall])
        colour, told = COLOURS.get(each.verdict, "#000000"), escape(each.told)
        drawn.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"><title>{told}</title></circle>'
        )
    box = f"0 0 {WIDTH:.0f} {height:.0f}"
    return f'<svg viewBox="{box}" width="{WIDTH:.0f}" role="img">{"".join(drawn)}</svg>'


def _features(survey: Survey) -> Iterator[str]:
    yield "<h2>Features</h2>"
    head = ("feature", "quantity", "value", "nominal", "from", "to", "values", "verdict", "")
    yield _table(head, (_row(each) for each in survey.features))


def _row(each: Feature) -> tuple[str, ...]:
    numbers = ("" if value is None else f"{value:g}" for value in (each.nominal, each.lower, each.upper))
    cells = (each.of, each.quantity, shown(each), *numbers, str(len(each.values)))
    return (*map(escape, cells), _dot(each.judged) + escape(each.judged), escape(each.doubt))


def _again(survey: Survey) -> Iterator[str]:
    if rows := repeated(survey):
        yield "<h2>Measured again</h2>"
        yield _table(("feature", *AGAIN[1:]), (tuple(map(escape, row)) for row in rows))


def _left_out(survey: Survey) -> Iterator[str]:
    rows = [
        tuple(map(escape, (one.of, f"{one.value:g} {one.unit}", one.tool, f"{one.at_ms / 1000:.1f} s", why)))
        for each in survey.features
        for one, why in each.bad
    ]
    if rows:
        yield "<h2>Values left out</h2>"
        yield _table(("feature", "value", "by", "at", "because"), rows)


def _unmeasured(survey: Survey) -> Iterator[str]:
    if survey.unmeasured:
        yield "<h2>Not measured</h2>"
        yield _table(
            ("measurement", "because"), ((escape(each.name), escape(each.why)) for each in survey.unmeasured)
        )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the cells are escaped already."""
    titles = "".join(f"<th>{escape(each)}</th>" for each in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"
