"""A plan as SVG: steps as boxes from top to bottom, orders as arrows, causal links as dashed curves that say their condition.

Coloured bars on a box are the resources that the step holds. The picture follows the reader's light or dark scheme.
"""

from collections.abc import Iterator, Mapping
from xml.sax.saxutils import escape

from engine.model.schedule import plainly
from engine.report.dot import orders
from engine.report.layout import Layout, layout
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId

CHARACTER, HEIGHT, GAP, SPACE, MARGIN, BAR = 7.3, 30, 28, 46, 16, 6
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#7f3c8d", "#666666")
STYLE = """
  svg { color-scheme: light dark; --ink: #1b1b1b; --paper: #ffffff; --box: #f3f5f8; --link: #2a6fb0; }
  @media (prefers-color-scheme: dark) { svg { --ink: #e8e8e8; --paper: #16181c; --box: #262a31; --link: #7db4ea; } }
  text { font: 12px ui-monospace, "DejaVu Sans Mono", monospace; fill: var(--ink); }
  .paper { fill: var(--paper); } .box { fill: var(--box); stroke: var(--ink); stroke-width: 1; }
  .order { stroke: var(--ink); stroke-width: 1.4; fill: none; }
  .link { stroke: var(--link); stroke-width: 1; stroke-dasharray: 4 3; fill: none; opacity: .75; }
"""


def plan(made: Plan) -> str:
    """The partial order with its causal links, the same bytes for the same plan."""
    picture = _Picture(made)
    return (
        "\n".join([*picture.head(), *picture.edges(), *picture.boxes(), *picture.legend(), "</svg>"]) + "\n"
    )


class _Picture:
    def __init__(self, made: Plan) -> None:
        self.made = made
        self.texts: dict[StepId, str] = {START: "start"}
        self.texts |= {step.id: f"{step.id} {step.operator}" for step in made.steps}
        self.texts[GOAL] = "goal"
        self.widths: dict[int, float] = {
            step: len(text) * CHARACTER + 2 * BAR + 12 for step, text in self.texts.items()
        }
        self.orders = list(orders(made))
        self.placed: Layout = layout(self.widths, self.orders, GAP)
        resources = dict.fromkeys(str(held) for step in made.steps for held in step.resources)
        self.colours = {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(resources)}
        legend = sum(len(name) * CHARACTER + 34 for name in self.colours)
        self.width = max(self.placed.width, legend) + 2 * MARGIN
        self.layers = max(self.placed.layer.values()) + 1
        self.height = self.layers * (HEIGHT + SPACE) + 2 * MARGIN

    def head(self) -> Iterator[str]:
        """The opening, the style, the arrow head and the paper."""
        size = f'viewBox="0 0 {self.width:.0f} {self.height:.0f}" width="{self.width:.0f}" height="{self.height:.0f}"'
        yield f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
        yield f"<style>{STYLE}</style>"
        yield '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        yield '<path d="M0 0L8 4L0 8z" fill="context-stroke"/></marker></defs>'
        yield f'<rect class="paper" width="{self.width:.0f}" height="{self.height:.0f}"/>'

    def _x(self, step: StepId) -> float:
        return self.placed.centre[step] + MARGIN + (self.width - 2 * MARGIN - self.placed.width) / 2

    def _top(self, step: StepId) -> float:
        return self.placed.layer[step] * (HEIGHT + SPACE) + MARGIN

    def edges(self) -> Iterator[str]:
        """Orders, then causal links."""
        for earlier, later in self.orders:
            x, y, to_x, to_y = self._x(earlier), self._top(earlier) + HEIGHT, self._x(later), self._top(later)
            yield f'<path class="order" marker-end="url(#head)" d="M{x:.1f} {y:.1f}{_curve(x, y, to_x, to_y)}"/>'
        fans: dict[StepId, int] = {}
        for link in self.made.links:
            yield self._link(link, fans)

    def _link(self, link: CausalLink, fans: dict[StepId, int]) -> str:
        """A dashed curve; those that leave one step leave it side by side."""
        index = fans[link.producer] = fans.get(link.producer, -1) + 1
        shift = 1.0 * (6 + 5 * (index // 2)) * (1 if index % 2 else -1)
        shift = max(-self.widths[link.producer] / 2 + 4, min(self.widths[link.producer] / 2 - 4, shift))
        into = max(-self.widths[link.consumer] / 2 + 4, min(self.widths[link.consumer] / 2 - 4, shift))
        x, y = self._x(link.producer) + shift, self._top(link.producer) + HEIGHT
        to_x, to_y = self._x(link.consumer) + into, self._top(link.consumer)
        said = (
            f"{self.texts[link.producer]} achieves {plainly(link.condition)} for {self.texts[link.consumer]}"
        )
        curve = f'd="M{x:.1f} {y:.1f}{_curve(x, y, to_x, to_y)}"'
        return f'<path class="link" marker-end="url(#head)" {curve}><title>{escape(said)}</title></path>'

    def boxes(self) -> Iterator[str]:
        """The start, the steps and the goal."""
        steps: Mapping[StepId, Step] = {step.id: step for step in self.made.steps}
        for step, text in self.texts.items():
            width, x, y = self.widths[step], self._x(step), self._top(step)
            left, radius = x - width / 2, 6 if step in steps else HEIGHT / 2
            yield f"<g><title>{escape(_tooltip(steps[step]) if step in steps else text)}</title>"
            yield f'<rect class="box" x="{left:.1f}" y="{y:.1f}" width="{width:.1f}" height="{HEIGHT}" rx="{radius}"/>'
            for index, held in enumerate(steps[step].resources if step in steps else ()):
                at = left + 3 + index * 4
                fill = self.colours[str(held)]
                yield f'<rect x="{at:.1f}" y="{y + 4:.1f}" width="3" height="{HEIGHT - 8}" fill="{fill}"/>'
            yield f'<text x="{x + BAR:.1f}" y="{y + HEIGHT / 2 + 4:.1f}" text-anchor="middle">{escape(text)}</text></g>'

    def legend(self) -> Iterator[str]:
        """Which colour is which resource."""
        x, y = float(MARGIN), self.height - MARGIN
        for name, fill in self.colours.items():
            yield f'<rect x="{x:.1f}" y="{y - 10:.1f}" width="12" height="12" fill="{fill}"/>'
            yield f'<text x="{x + 17:.1f}" y="{y:.1f}">{escape(name)}</text>'
            x += len(name) * CHARACTER + 34


def _curve(x: float, y: float, to_x: float, to_y: float) -> str:
    """The rest of a path that leaves downwards and arrives from above."""
    bend = min(SPACE, max(18.0, (to_y - y) / 2))
    return f"C{x:.1f} {y + bend:.1f} {to_x:.1f} {to_y - bend:.1f} {to_x:.1f} {to_y:.1f}"


def _tooltip(step: Step) -> str:
    held = f", holds {', '.join(map(str, step.resources))}" if step.resources else ""
    return f"{step.id} {step.operator}, lasts {step.duration}, costs {step.cost}{held}"
