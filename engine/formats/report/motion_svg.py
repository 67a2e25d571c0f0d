"""A motion as a picture: the values of all joints over time, and below them their speeds."""

from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np

from cellwright.engine.formats.report.palette import colours
from cellwright.engine.formats.report.svg import INK, PAPER
from cellwright.engine.model.geometry import Floats

WIDTH, HEIGHT, MARGIN, LINE = (
    860.0,
    300.0,
    50.0,
    18.0,
)  # pixels; the height is that of one of the two diagrams
MOMENTS = 241  # at which values are drawn


def picture(joints: Sequence[str], times: Floats, values: Floats, speeds: Floats) -> str:
    """The SVG of joint values and speeds (n, k) at times (n,), in s."""
    inks = colours(joints)
    tall = 2 * HEIGHT + LINE * (len(joints) + 1)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="{tall:g}" '
        f'viewBox="0 0 {WIDTH:g} {tall:g}" font-family="sans-serif" font-size="12">',
        f'<rect width="100%" height="100%" fill="{PAPER}"/>',
        *_diagram(times, values, inks, 0.0, "joint values, rad or m"),
        *_diagram(times, speeds, inks, HEIGHT, "joint speeds, rad/s or m/s"),
    ]
    for n, (name, ink) in enumerate(inks.items()):
        lines.append(_text(MARGIN, 2 * HEIGHT + LINE * n, name, ink))
    return "\n".join([*lines, "</svg>"]) + "\n"


def _diagram(times: Floats, values: Floats, inks: Mapping[str, str], top: float, title: str) -> Iterator[str]:
    low, high, whole = float(values.min()), float(values.max()), max(float(times[-1]), 1e-9)
    across, down = (WIDTH - 2 * MARGIN) / whole, (HEIGHT - 2 * MARGIN) / max(high - low, 1e-9)
    x, y = MARGIN + across * times, top + HEIGHT - MARGIN - down * (values - low)
    base, right = top + HEIGHT - MARGIN, WIDTH - MARGIN
    yield f'<path d="M {MARGIN:g},{top + MARGIN:g} V {base:g} H {right:g}" fill="none" stroke="{INK}"/>'
    yield _text(MARGIN, top + MARGIN - LINE, title, INK)
    yield _text(4.0, top + MARGIN, f"{high:.2f}", INK)
    yield _text(4.0, base, f"{low:.2f}", INK)
    yield _text(right - LINE, base + LINE, f"{whole:.2f} s", INK)
    for n, ink in enumerate(inks.values()):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in np.column_stack([x, y[:, n]]))
        yield f'<polyline points="{points}" fill="none" stroke="{ink}" stroke-width="1.5"/>'


def _text(x: float, y: float, said: str, ink: str) -> str:
    return f'<text x="{x:g}" y="{y:g}" fill="{ink}">{escape(said)}</text>'
