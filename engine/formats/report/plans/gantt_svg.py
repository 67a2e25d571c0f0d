"""A schedule as SVG: its Gantt chart with a tooltip for each bar.

Colours are those of the jobs. Steps that are jobs of their own have the colour of their operator,
with a legend.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import escape

from cellwright.engine.formats.report.drawing.colour_palette import assign_colours
from cellwright.engine.formats.report.drawing.plan_svg import INK, LABEL_FONTS, PAPER
from cellwright.engine.formats.report.plans.gantt_chart import (
    SHOP,
    BarKind,
    GanttBar,
    GanttRow,
    gantt_rows,
    join_short_bars,
    schedule_summary,
    window_rows,
)
from cellwright.engine.model.shop_scheduling import Schedule, Shop
from cellwright.engine.model.window_breaches import WindowSpan

STEP_JOB_NAME = re.compile(r"\d+ (\w+)")  # the name of a job that is one step of a plan
HEIGHT, GAP, MARGIN, WIDTH, CHARACTER, LINE = 22, 6, 16, 1000, 7.3, 16
GANTT_STYLE = """
  .bar:hover { stroke-width: 2; }
  @media (prefers-color-scheme: dark) { .paper { fill: #16181c; } .text { fill: #e8e8e8; } \
.grid { stroke: #444a55; } }
"""


def draw_gantt(
    shop: Shop,
    schedule: Schedule,
    unit: str = "",
    scope: str = SHOP,
    note: str = "",
    spans: Sequence[WindowSpan] = (),
) -> str:
    """The chart with the windows between events, below it its makespan with what is proved of it,
    and a note.

    The same schedule gives the same bytes.
    """
    lines = (*gantt_rows(shop, schedule), *window_rows(spans, schedule.makespan, unit))
    left = MARGIN + max((len(row.name) for row in lines), default=0) * CHARACTER + GAP
    height = 2 * MARGIN + (len(lines) + 2) * (HEIGHT + GAP)
    scale = WIDTH / max(1, schedule.makespan)
    body = [*_time_grid(schedule, left, scale, len(lines), unit)]
    kinds = [step[1] if (step := STEP_JOB_NAME.match(job.name)) else job.name for job in shop.jobs]
    kind_fills = assign_colours(kinds)
    fills = [kind_fills[kind] for kind in kinds]
    named = {job.name for job in shop.jobs}
    legend = list(
        _legend_lines({kind: fill for kind, fill in kind_fills.items() if kind not in named})
    )
    below = MARGIN + len(lines) * (HEIGHT + GAP) + 3 * LINE
    body += [
        entry
        for number, line in enumerate(legend)
        for entry in _legend_entries(line, below + number * LINE)
    ]
    for number, row in enumerate(lines):
        crowded = len(row.bars) > 2 * WIDTH  # more bars than can be seen
        shown = GanttRow(row.name, tuple(join_short_bars(row.bars, 1 / scale))) if crowded else row
        body += _gantt_row(shown, MARGIN + number * (HEIGHT + GAP), left, scale, fills)
    caption_lines = [schedule_summary(schedule, unit, scope), *([note] if note else [])]
    height += (len(caption_lines) - 1 + len(legend)) * LINE
    return (
        "\n".join(
            [*_gantt_opening(left + WIDTH + 2 * MARGIN, height, caption_lines), *body, "</svg>"]
        )
        + "\n"
    )


def _gantt_opening(width: float, height: float, caption_lines: Sequence[str]) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="{LABEL_FONTS}" font-size="12">'
    )
    yield f"<title>{escape(caption_lines[0])}</title>"
    yield f"<style>{GANTT_STYLE}</style>"
    yield f'<rect class="paper" width="100%" height="100%" fill="{PAPER}"/>'
    for below, line in enumerate(reversed(caption_lines)):
        y = height - MARGIN - below * LINE
        yield f'<text class="text" x="{MARGIN}" y="{y:.0f}" fill="{INK}">{escape(line)}</text>'


def _legend_lines(fills: Mapping[str, str]) -> Iterator[list[tuple[float, str, str]]]:
    """Lines of entries that fit side by side: where each begins, its name and its colour."""
    line: list[tuple[float, str, str]] = []
    x = float(MARGIN)
    for name, fill in fills.items():
        wide = (len(name) + 4) * CHARACTER
        if line and x + wide > WIDTH:
            yield line
            line, x = [], float(MARGIN)
        line.append((x, name, fill))
        x += wide
    if line:
        yield line


def _legend_entries(line: Sequence[tuple[float, str, str]], y: float) -> Iterator[str]:
    for x, name, fill in line:
        yield f'<rect x="{x:.1f}" y="{y - 9:.0f}" width="10" height="10" fill="{fill}"/>'
        yield f'<text class="text" x="{x + 14:.1f}" y="{y:.0f}" fill="{INK}">{escape(name)}</text>'


def _time_grid(
    schedule: Schedule, left: float, scale: float, lines: int, unit: str
) -> Iterator[str]:
    """Lines at round times, and a dashed line at the lower bound."""
    step = 1
    while step * scale < 60:
        step *= 5 if str(step)[0] == "1" else 2
    bottom = MARGIN + lines * (HEIGHT + GAP)
    for time in range(0, schedule.makespan + 1, step):
        x = left + time * scale
        yield _vertical_line(x, bottom, '#c8ccd4"')
        yield (
            f'<text class="text" x="{x:.1f}" y="{bottom + 14}" fill="{INK}" '
            f'text-anchor="middle">{time}</text>'
        )
    yield _vertical_line(
        left + schedule.lower_bound * scale, bottom, '#d55e00" stroke-dasharray="4 3"'
    )
    if unit:
        end = left + WIDTH
        yield (
            f'<text class="text" x="{end:.1f}" y="{bottom + 28}" fill="{INK}" '
            f'text-anchor="end">{escape(unit)}</text>'
        )


def _vertical_line(x: float, bottom: float, stroke: str) -> str:
    return (
        f'<line class="grid" x1="{x:.1f}" y1="{MARGIN}" x2="{x:.1f}" y2="{bottom}" '
        f'stroke="{stroke}/>'
    )


def _gantt_row(
    row: GanttRow, y: float, left: float, scale: float, fills: Sequence[str]
) -> Iterator[str]:
    name = escape(row.name)
    yield (
        f'<text class="text" x="{left - GAP:.1f}" y="{y + 15:.0f}" fill="{INK}" '
        f'text-anchor="end">{name}</text>'
    )
    for bar in row.bars:
        colour = fills[bar.job] if bar.job >= 0 else "#8a8f98"
        yield _gantt_bar(
            bar, left + bar.start * scale, y, max(0.5, (bar.end - bar.start) * scale), colour
        )


def _gantt_bar(bar: GanttBar, x: float, y: float, width: float, colour: str) -> str:
    opacity = {BarKind.HOLD: 0.35, BarKind.WINDOW: 0.15}.get(bar.kind, 0.85)
    tooltip = escape(f"{bar.detail}, {bar.start} to {bar.end}")
    rect = (
        f'<rect class="bar" x="{x:.1f}" y="{y:.0f}" width="{width:.1f}" height="{HEIGHT}" '
        f'rx="2" fill="{colour}" '
        f'fill-opacity="{opacity}" stroke="{colour}" '
        f'stroke-width="0.5"><title>{tooltip}</title></rect>'
    )
    if bar.kind is BarKind.WINDOW:
        done = width * (bar.reached - bar.start) / max(1, bar.end - bar.start)
        middle = y + HEIGHT / 2
        rect += (
            f'<line x1="{x:.1f}" y1="{middle:.0f}" x2="{x + done:.1f}" y2="{middle:.0f}" '
            f'stroke="{colour}" stroke-width="3" pointer-events="none"/>'
        )
    if len(bar.label) * CHARACTER + 4 > width:
        return rect
    fill = "#ffffff" if bar.kind is BarKind.STAGE else INK
    label = (
        f'<text x="{x + 3:.1f}" y="{y + 15:.0f}" fill="{fill}" '
        f'pointer-events="none">{escape(bar.label)}</text>'
    )
    return rect + label
