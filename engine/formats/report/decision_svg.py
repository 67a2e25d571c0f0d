"""A decision tree as SVG, from left to right: actions are boxes, conclusions are rounded boxes, outcomes label the lines."""

from collections.abc import Iterator
from dataclasses import dataclass
from xml.sax.saxutils import escape

from cellwright.engine.formats.report.diagnosis import concluded, number
from cellwright.engine.model.troubleshooting import Conclude, Tree, Troubleshooting

CHARACTER, HEIGHT, GAP, MARGIN, BETWEEN = 7.3, 38, 12, 20, 150
INK, PAPER, BOX, LEAF = "#1b1b1b", "#ffffff", "#e3ecf6", "#e6f3ea"


@dataclass(frozen=True, slots=True)
class _Placed:
    """A part of the tree with its position: `x`, `y` is the middle of its left edge."""

    lines: tuple[str, str]
    leaf: bool
    x: float
    y: float
    children: tuple[tuple[str, "_Placed"], ...]


def decision_tree(problem: Troubleshooting, root: Tree, cost: float) -> str:
    """The picture. The same tree gives the same bytes."""
    width = CHARACTER * max(len(line) for line in _texts(problem, root)) + 16
    placed, below = _place(problem, root, MARGIN, MARGIN + 28.0, width)
    right = max(part.x for part in _all(placed)) + width + MARGIN
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{right:.0f}" height="{below + MARGIN:.0f}" '
        f'viewBox="0 0 {right:.0f} {below + MARGIN:.0f}" font-family="sans-serif" font-size="12">'
    )
    title = f'<text x="{MARGIN}" y="{MARGIN + 4}" fill="{INK}">expected cost {number(cost)}</text>'
    paper = f'<rect width="100%" height="100%" fill="{PAPER}"/>'
    return "\n".join([head, paper, title, *_lines(placed, width), *_boxes(placed, width), "</svg>"]) + "\n"


def _texts(problem: Troubleshooting, part: Tree) -> Iterator[str]:
    yield from _said(problem, part)
    if not isinstance(part, Conclude):
        for _, following in part.branches:
            yield from _texts(problem, following)


def _said(problem: Troubleshooting, part: Tree) -> tuple[str, str]:
    share = f"{100 * part.probability:.1f} %"
    if isinstance(part, Conclude):
        return concluded(problem, part), share
    return problem.actions[part.action].name, f"{share}, cost {number(part.cost)}"


def _place(problem: Troubleshooting, part: Tree, x: float, top: float, width: float) -> tuple[_Placed, float]:
    """The part with everything below it in the tree, placed from `top` downwards; and its lower end."""
    lines = _said(problem, part)
    if isinstance(part, Conclude):
        return _Placed(lines, True, x, top + HEIGHT / 2, ()), top + HEIGHT + GAP
    children: list[tuple[str, _Placed]] = []
    for outcome, following in part.branches:
        child, top = _place(problem, following, x + width + BETWEEN, top, width)
        children.append((problem.actions[part.action].outcomes[outcome], child))
    middle = (children[0][1].y + children[-1][1].y) / 2
    return _Placed(lines, False, x, middle, tuple(children)), top


def _all(part: _Placed) -> Iterator[_Placed]:
    yield part
    for _, child in part.children:
        yield from _all(child)


def _lines(root: _Placed, width: float) -> Iterator[str]:
    for part in _all(root):
        for outcome, child in part.children:
            start, bend = part.x + width, part.x + width + 24
            way = f"M {start:.1f} {part.y:.1f} C {bend:.1f} {part.y:.1f} {start:.1f} {child.y:.1f} {bend:.1f} {child.y:.1f}"
            yield f'<path d="{way} H {child.x:.1f}" fill="none" stroke="{INK}"/>'
            yield (
                f'<text x="{child.x - 6:.1f}" y="{child.y - 5:.1f}" text-anchor="end" fill="{INK}">'
                f"{escape(outcome)}</text>"
            )


def _boxes(root: _Placed, width: float) -> Iterator[str]:
    for part in _all(root):
        top, round_ = part.y - HEIGHT / 2, 16 if part.leaf else 3
        fill = LEAF if part.leaf else BOX
        yield (
            f'<rect x="{part.x:.1f}" y="{top:.1f}" width="{width:.1f}" height="{HEIGHT}" rx="{round_}" '
            f'fill="{fill}" stroke="{INK}"/>'
        )
        for place, line in enumerate(part.lines):
            y = top + 15 + 15 * place
            yield f'<text x="{part.x + 8:.1f}" y="{y:.1f}" fill="{INK}">{escape(line)}</text>'
