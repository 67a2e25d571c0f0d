"""A net of contact states in Graphviz's DOT language: places are ellipses (robots filled), transitions are boxes."""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.task_space import Net, Transfer
from cellwright.kb.diagnostics import escaped


def net(made: Net) -> str:
    """The net. Places with tokens at the start have a thick rim; arcs say what they move."""
    return "\n".join(["digraph states {", *(f"  {line}" for line in _lines(made)), "}"]) + "\n"


def _lines(made: Net) -> Iterator[str]:
    yield 'graph [rankdir=LR, fontname="Helvetica"];'
    yield 'node [fontname="Helvetica", fontsize=11];'
    yield 'edge [fontname="Helvetica", fontsize=9];'
    for place in made.places:
        look = ', style=filled, fillcolor="#dbe9f8"' if place.robot else ""
        rim = ", penwidth=2.5" if place.initial else ""
        yield f'{place.name} [shape=ellipse, label="{place.name}\\n{_escaped(place.say)}"{look}{rim}];'
    for number, each in enumerate(made.transitions, 1):
        condition = "".join(f"\\n[{_escaped(str(one))}]" for one in each.restrictions)
        yield f'T{number} [shape=box, height=0.3, label="{_escaped(each.name)}{condition}"];'
        for name in dict.fromkeys(each.inputs):
            yield f'{name} -> T{number} [label="{_moved(each.transfers, source=name)}"];'
        for name in dict.fromkeys(each.outputs):
            yield f'T{number} -> {name} [label="{_moved(each.transfers, target=name)}"];'


def _moved(transfers: Sequence[Transfer], source: str = "", target: str = "") -> str:
    """The tokens that an arc moves, by type."""
    counts: dict[str, tuple[int, int]] = {}
    for row in transfers:
        if row.source == source or row.target == target:
            least, most = counts.get(row.type, (0, 0))
            counts[row.type] = (least + row.least, most + row.most)
    return _escaped(", ".join(f"{name}:{_number(*n)}" for name, n in counts.items()))


def _number(least: int, most: int) -> str:
    return str(most) if least == most else f"{least}..{most}"


def _escaped(text: str) -> str:
    return escaped(text).replace("\\", "\\\\").replace('"', '\\"')
