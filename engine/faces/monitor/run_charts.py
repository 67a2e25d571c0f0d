"""SVG charts of a run: a Gantt chart with a line at now, and measured values beside limits."""

from collections.abc import Collection, Iterator, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from cellwright.engine.faces.monitor.run_follower import WatchedRun
from cellwright.engine.formats.report.runs.run_display import StepBar
from cellwright.engine.formats.report.runs.run_report import duration_text

WIDTH, LEFT, HEIGHT, GAP = 1000, 170, 20, 6
MOST_BARS = 300  # that are drawn; of more, those nearest to now
STEP_LOOKS = {  # fill, and the sign that a step has beside its colour
    "planned": ("#b9c0cc", ""),
    "running": ("#e0a100", "▶"),
    "done": ("#2f8f4e", "✓"),
    "failed": ("#c8321f", "✗"),
}
STEP_INK = {"planned": "#1b1b1b", "running": "#1b1b1b", "done": "#ffffff", "failed": "#ffffff"}
RUN_CHART_STYLE = """
  .planned .bar { stroke: #5a6270; stroke-dasharray: 3 2; } \
.step:focus .bar { stroke: #1f6fb5; stroke-width: 2.5; }
  .bar { cursor: pointer; } .chosen { stroke: #1b1b1b; stroke-width: 2.5; }
  .text { fill: #1b1b1b; } .now { stroke: #1f6fb5; } .grid { stroke: #c8ccd4; }
  .body--dark .text { fill: #e8e8e8; } .body--dark .chosen { stroke: #ffffff; } \
.body--dark .grid { stroke: #444a55; }
"""


def gantt_chart(run: WatchedRun, now_ms: int, chosen: Collection[str] = ()) -> str:
    """The steps of all plans, a lane for each device, with a line at now.

    The step `chosen` has a rim.
    """
    bars = _bars_near(run, now_ms)
    streams = list(dict.fromkeys(drawn_bar.stream for drawn_bar in bars))
    first = (
        min((drawn_bar.start_ms for drawn_bar in bars), default=0) if len(bars) == MOST_BARS else 0
    )
    ends = [drawn_bar.start_ms + drawn_bar.lasts_ms for drawn_bar in bars]
    last = max([first + 1, *([now_ms, run.end_ms] if not first else []), *ends])
    scale = (WIDTH - LEFT - 10) / (last - first)
    height = (len(streams) + 1) * (HEIGHT + GAP) + 10
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="100%" '
        'role="img" '
        'aria-label="steps over time" font-family="monospace" '
        f'font-size="12"><style>{RUN_CHART_STYLE}</style>'
    ]
    for row, stream in enumerate(streams):
        y = row * (HEIGHT + GAP) + 4
        lines.append(f'<text class="text" x="4" y="{y + 14}">{escape(stream[:22])}</text>')
        lines += [
            _bar_svg(drawn_bar, y, (first, scale), chosen)
            for drawn_bar in bars
            if drawn_bar.stream == stream
        ]
    x, bottom = LEFT + min(now_ms - first, last - first) * scale, height - HEIGHT
    lines.append(
        f'<line class="now" x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{bottom}" stroke-dasharray="4 '
        '3" stroke-width="2"/>'
    )
    side = "end" if x > WIDTH / 2 else "start"
    lines.append(
        f'<text class="text" x="{x:.1f}" y="{height - 6}" text-anchor="{side}">now '
        f"{duration_text(now_ms)}</text></svg>"
    )
    return "\n".join(lines)


def _bars_near(run: WatchedRun, now_ms: int) -> list[StepBar]:
    """The bars that are drawn: all, or of very many those that are nearest to now."""
    bars = [*run.past, *run.bars.values()]
    if len(bars) <= MOST_BARS:
        return bars
    near = sorted(range(len(bars)), key=lambda n: abs(bars[n].start_ms - now_ms))[:MOST_BARS]
    return [bars[n] for n in sorted(near)]


def _bar_svg(bar: StepBar, y: int, axis: tuple[int, float], chosen: Collection[str]) -> str:
    fill, sign = STEP_LOOKS[bar.standing]
    first, scale = axis
    x, width = LEFT + (bar.start_ms - first) * scale, max(1.0, bar.lasts_ms * scale)
    rim = " chosen" if bar.step in chosen else ""
    said = (
        f"{bar.step}: {bar.standing}, {duration_text(bar.start_ms)} to "
        f"{duration_text(bar.start_ms + bar.lasts_ms)}"
    )
    whole = width > 7.3 * (len(bar.step) + 2)
    inside = f"{sign} {bar.step}".strip() if whole else sign if width > 12 else ""
    beside = "" if inside or bar.standing not in ("failed", "running") else sign
    return (
        f'<g class="step {bar.standing}" tabindex="0" role="button" '
        f"data-step={quoteattr(bar.step)}><title>{escape(said)}</title>"
        f'<rect class="bar{rim}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="{HEIGHT}" '
        f'rx="2" fill="{fill}"/>'
        f'<text x="{x + 3:.1f}" y="{y + 14}" fill="{STEP_INK[bar.standing]}" '
        f'pointer-events="none">{escape(inside)}</text>'
        f'<text class="text" x="{x + width + 1:.1f}" y="{y + 14}" '
        f'pointer-events="none">{beside}</text></g>'
    )


def run_chart(results: Sequence[dict[str, Any]]) -> str:
    """Values of one feature in the order in which they were measured, with nominal value and
    limits.
    """
    values = [result["value"] for result in results]
    limits = [results[-1].get(key) for key in ("lower", "nominal", "upper")]
    marked = [*values, *(limit for limit in limits if limit is not None)]
    low, high = min(marked), max(marked)
    room = (high - low) or 1.0
    low, high = low - 0.1 * room, high + 0.1 * room

    def y(value: float) -> float:
        return float(110 - 100 * (value - low) / (high - low))

    step = 360 / max(1, len(values) - 1)
    points = [(20 + n * step, y(value)) for n, value in enumerate(values)]
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 120" width="400" role="img" '
        'aria-label="values in order">'
        f"<style>{RUN_CHART_STYLE}</style>"
    ]
    for value, dash in zip(limits, ("6 3", "2 2", "6 3"), strict=True):
        if value is not None:
            at = y(value)
            lines.append(
                f'<line class="grid" x1="10" y1="{at:.1f}" x2="390" y2="{at:.1f}" '
                f'stroke-dasharray="{dash}"/>'
            )
            lines.append(
                f'<text class="text" x="392" y="{at:.1f}" font-size="9" '
                f'text-anchor="end">{value:g}</text>'
            )
    lines += list(_value_points(points, results))
    return "\n".join([*lines, "</svg>"])


def _value_points(
    points: Sequence[tuple[float, float]], results: Sequence[dict[str, Any]]
) -> Iterator[str]:
    yield (
        '<polyline fill="none" stroke="#8a8f98" '
        f'points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'
    )
    for (x, y), measured in zip(points, results, strict=True):
        passed = measured.get("passed")
        fill = STEP_LOOKS["failed" if passed is False else "done" if passed else "planned"][0]
        mark = (
            f'<rect x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8" fill="{fill}">'
            if passed is False
            else f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{fill}">'
        )
        end = "</rect>" if passed is False else "</circle>"
        yield (
            f"{mark}<title>{measured['value']:g} "
            f"{escape(str(measured.get('unit', '')))}</title>{end}"
        )


CAUSE_LETTERS = "abcdefgh"
CAUSE_COLOURS = (
    "#1f6fb5",
    "#8f6400",
    "#2f8f4e",
    "#a040a0",
    "#c8321f",
    "#5a6270",
    "#7a5c2e",
    "#20a0a0",
)


def belief_chart(findings: Sequence[dict[str, Any]]) -> str:
    """How the belief in each cause goes from test to test: a row for each test, a bar for each
    cause, with its share.
    """
    beliefs = [
        dict(test_finding.get("belief") or test_finding.get("causes") or ())
        for test_finding in findings
    ]
    last = {
        cause: max(belief.get(cause, 0.0) for belief in beliefs)
        for belief in beliefs
        for cause in belief
    }
    causes = sorted(last, key=lambda cause: -last[cause])[: len(CAUSE_COLOURS)]
    height = 26 * len(beliefs) + 18 * len(causes) + 12
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 560 {height}" width="560" '
        'role="img" '
        f'aria-label="beliefs" font-size="11"><style>{RUN_CHART_STYLE}</style>'
    ]
    for row, (test_finding, belief) in enumerate(zip(findings, beliefs, strict=True)):
        said = str(test_finding.get("action") or "found").partition("(")[0]
        lines.append(f'<text class="text" x="4" y="{26 * row + 18}">{escape(said[:30])}</text>')
        lines += _belief_bars(belief, causes, 26 * row + 4)
    for row, (letter, colour, cause) in enumerate(
        zip(CAUSE_LETTERS, CAUSE_COLOURS, causes, strict=False)
    ):
        y = 26 * len(beliefs) + 18 * row + 8
        lines.append(f'<rect x="200" y="{y}" width="12" height="12" fill="{colour}"/>')
        lines.append(f'<text class="text" x="218" y="{y + 10}">{letter}: {escape(cause)}</text>')
    return "\n".join([*lines, "</svg>"])


def _belief_bars(belief: dict[str, float], causes: Sequence[str], y: int) -> Iterator[str]:
    """The bars of one row, each with the letter of its cause; what is left is believed of other
    causes.
    """
    x = 200.0
    for letter, colour, cause in zip(CAUSE_LETTERS, CAUSE_COLOURS, causes, strict=False):
        width, percent = 340 * belief.get(cause, 0.0), f"{round(100 * belief.get(cause, 0.0))} %"
        inside = f"{letter} {percent}" if width > 44 else letter if width > 12 else ""
        yield (
            f'<g><title>{escape(cause)}: {percent}</title><rect x="{x:.1f}" y="{y}" '
            f'width="{width:.1f}" height="20" '
            f'fill="{colour}"/><text x="{x + 3:.1f}" y="{y + 14}" '
            f'fill="#ffffff">{inside}</text></g>'
        )
        x += width
