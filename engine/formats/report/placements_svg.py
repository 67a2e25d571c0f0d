"""Where a part may lie, as a graph: an edge joins two placements that some hold serves; the way that is taken is bold."""

import math
from collections.abc import Iterator
from itertools import pairwise
from xml.sax.saxutils import escape

from cellwright.engine.pipelines.placing.resting import GOAL, START, Resting

WIDTH, HEIGHT, RADIUS = 760, 560, 34
STYLE = """text{font:13px sans-serif;text-anchor:middle;fill:#222}
.e{stroke:#b9c0c8;stroke-width:1.5}.t{stroke:#d39b00;stroke-width:4}
.n{fill:#eef2f6;stroke:#5b6b7b;stroke-width:1.5}.u{fill:#f7f7f7;stroke:#bbb}.c{fill:#ffe9ad;stroke:#d39b00;stroke-width:2.5}
.k{font-size:11px;fill:#555}"""


def picture(shown: Resting, part: str) -> str:
    """The SVG of a graph of placements."""
    lines = "".join((*_edges(shown), *_nodes(shown)))
    said = f"Where {part} may lie: in a circle the holds that serve there, on a line those that serve at both ends"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
        f'<style>{STYLE}</style><rect width="100%" height="100%" fill="white"/>'
        f'<text x="{WIDTH / 2}" y="24">{escape(said)}</text>{lines}</svg>\n'
    )


def _places(shown: Resting) -> dict[str, tuple[float, float]]:
    """The start on the left, the goal on the right, and the facets on an arc above and one below."""
    facets = [name for name in shown.holds if name not in (START, GOAL)]
    found = {START: (70.0, HEIGHT / 2), GOAL: (WIDTH - 70.0, HEIGHT / 2)}
    upper = (len(facets) + 1) // 2
    for row, sense in ((facets[:upper], -1), (facets[upper:], 1)):
        for n, name in enumerate(row):
            angle = math.pi * (n + 0.5) / len(row)
            found[name] = WIDTH / 2 - 235 * math.cos(angle), HEIGHT / 2 + 10 + sense * 200 * math.sin(angle)
    return found


def _edges(shown: Resting) -> Iterator[str]:
    places, taken = _places(shown), {frozenset(pair) for pair in pairwise(shown.taken)}
    order = sorted(shown.ways.items(), key=lambda each: frozenset(each[0]) in taken)
    for (one, other), count in order:
        (x1, y1), (x2, y2) = places[one], places[other]
        kind = "t" if frozenset((one, other)) in taken else "e"
        yield f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'
        if kind == "t":
            x, y = (x1 + x2) / 2, (y1 + y2) / 2 - 7
            yield f'<text x="{x:.1f}" y="{y:.1f}">{count}</text>'


def _nodes(shown: Resting) -> Iterator[str]:
    for name, (x, y) in _places(shown).items():
        kind = "c" if name in shown.taken else "n" if shown.holds[name] else "u"
        yield f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS}"/>'
        yield f'<text x="{x:.1f}" y="{y:.1f}">{escape(name)}</text>'
        yield f'<text class="k" x="{x:.1f}" y="{y + 16:.1f}">{shown.holds[name]}</text>'
