"""Where names stand in a picture: beside what they name, none on another."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

SIZE_PIXELS = 13  # the height of a line of text
WIDTH_PIXELS = 7.2  # the mean width of a character
NEAR_PIXELS = 6.0  # between a name and what it names
DIRECTIONS = 16
REACH = 14  # rings around a point on which its name is tried

Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass(frozen=True, slots=True)
class Label:
    """A name, the point that it names, and the left end of its base line, all in pixels."""

    text: str
    point: tuple[float, float]
    at: tuple[float, float]

    @property
    def far(self) -> bool:
        """Whether a line must lead from the name to its point."""
        left, top, right, bottom = _box(self.text, *self.at)
        x, y = self.point
        away = math.hypot(max(left - x, 0.0, x - right), max(top - y, 0.0, y - bottom))
        return away > 2 * NEAR_PIXELS

    @property
    def end(self) -> tuple[float, float]:
        """Where the line from the point ends: at the nearest place on the frame of the name."""
        left, top, right, bottom = _box(self.text, *self.at)
        return min(max(self.point[0], left), right), min(max(self.point[1], top), bottom)


def placed(
    named: Sequence[tuple[str, tuple[float, float]]], size: tuple[int, int], taken: Sequence[Box] = ()
) -> list[Label]:
    """A label for each name and its point, in a picture of this size; none lies on another or on what is `taken`.

    A name for which there is no room near its point is left out.
    """
    boxes, found = list(taken), []
    for text, point in named:
        for x, y in _positions(text, point):
            box = _box(text, x, y)
            inside = box[0] >= 0 and box[1] >= 0 and box[2] <= size[0] and box[3] <= size[1]
            if inside and not any(_overlap(box, other) for other in boxes):
                boxes.append(box)
                found.append(Label(text, point, (x, y)))
                break
    return found


def _positions(text: str, point: tuple[float, float]) -> Iterator[tuple[float, float]]:
    """Places for the left end of the base line: first above the point, then farther and farther round about it."""
    half = WIDTH_PIXELS * len(text) / 2
    for ring in range(REACH):
        away = NEAR_PIXELS + ring * SIZE_PIXELS
        for number in range(DIRECTIONS):
            turn = (number + 1) // 2 * (-1) ** number * 2 * math.pi / DIRECTIONS - math.pi / 2
            across, down = math.cos(turn), math.sin(turn)
            yield (
                point[0] + across * (away + half) - half,
                point[1] + down * away + SIZE_PIXELS * (1 + down) / 2,
            )


def _box(text: str, x: float, y: float) -> Box:
    return x, y - SIZE_PIXELS, x + WIDTH_PIXELS * len(text), y + 3.0


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
