"""Which parts an image shows, for people and for programs."""

from collections.abc import Iterator, Sequence
from typing import Any

from rich.text import Text

from cellwright.engine.model.ranging import Named, Recognised, Sight, Unexplained
from cellwright.engine.model.wording import counted


def text(found: Recognised) -> Text:
    """The parts that are seen and where, what is unclear, and why others are not found."""
    return Text("\n".join(_lines(found)) or "there is no part to look for")


def _lines(found: Recognised) -> Iterator[str]:
    for each in found.named:
        yield from _named(each)
    for unclear in found.unclear:
        either = (
            f"either {' or '.join(unclear.parts)}" if len(unclear.parts) > 1 else _again(unclear.parts[0])
        )
        yield f"{either}, {_at(unclear.sights[0])}: {unclear.sights[0].shown:.0%} of it is seen"
    for left in found.unexplained:
        yield f"no part that is looked for, {_where(left.middle_m)}: {counted(left.pixels, 'pixel')}, {_frame(left)}"
    for name, why in found.missing.items():
        yield f"{name} is not found: {why}"


def _again(part: str) -> str:
    return f"looks like {part}, as does something else"


def _named(each: Named) -> Iterator[str]:
    best = each.best
    yield f"{best.part}, {_at(best)}: by {counted(best.faces, 'face')}, {best.shown:.0%} of it is seen"
    if len(each.equivalent) > 1:
        yield f"  it is symmetric: {len(each.equivalent)} poses look the same"
    if len(each.poses) > 1:
        yield f"  {len(each.poses)} poses explain the image equally well"


def _at(sight: Sight) -> str:
    return _where([float(each) for each in sight.T_eye_part[:3, 3]])


def _where(point: Sequence[float]) -> str:
    return f"at ({', '.join(f'{1e3 * each:z.1f}' for each in point)}) mm from the eye"


def _frame(left: Unexplained) -> str:
    window = left.window
    return f"columns {window.left} to {window.right}, rows {window.top} to {window.bottom}"


def content(found: Recognised) -> dict[str, Any]:
    """The same as plain values, in metres."""
    return {
        "parts": [
            {
                **_sight(each.best),
                "poses": [T.tolist() for T in each.poses],
                "equivalent": [T.tolist() for T in each.equivalent],
            }
            for each in found.named
        ],
        "unclear": [[_sight(each) for each in unclear.sights] for unclear in found.unclear],
        "unexplained": [
            {
                "pixels": each.pixels,
                "frame": [each.window.left, each.window.top, each.window.right, each.window.bottom],
                "middle": list(each.middle_m),
            }
            for each in found.unexplained
        ],
        "missing": dict(found.missing),
    }


def _sight(each: Sight) -> dict[str, Any]:
    return {
        "part": each.part,
        "T_eye_part": each.T_eye_part.tolist(),
        "faces": each.faces,
        "shown": each.shown,
    }
