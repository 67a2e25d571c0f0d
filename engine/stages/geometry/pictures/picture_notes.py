"""What is written into a picture: labels that do not overlap, contact depths and a legend."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Contact
from cellwright.engine.stages.geometry.pictures.picture_surfaces import (
    KIND_COLOURS,
    Colour,
    PictureCamera,
    PictureSurface,
    triangles_in_world,
)
from cellwright.engine.stages.geometry.pictures.raster import fill

SIZE_PIXELS = 13  # the height of a line of text
WIDTH_PIXELS = 7.2  # the mean width of a character
NEAR_PIXELS = 6.0  # between a name and what it names
LABEL_DIRECTIONS = 16
LABEL_RINGS = 14  # rings around a point on which its name is tried

Box = tuple[float, float, float, float]  # left, top, right, bottom


@dataclass(frozen=True, slots=True)
class PictureLabel:
    """A name, the point that it names, and the left end of its base line, all in pixels."""

    text: str
    point: tuple[float, float]
    at: tuple[float, float]

    @property
    def far(self) -> bool:
        """Whether a line must lead from the name to its point."""
        x_min, top, right, bottom = _label_box(self.text, *self.at)
        x, y = self.point
        away = math.hypot(max(x_min - x, 0.0, x - right), max(top - y, 0.0, y - bottom))
        return away > 2 * NEAR_PIXELS

    @property
    def end(self) -> tuple[float, float]:
        """Where the line from the point ends: at the nearest place on the frame of the name."""
        x_min, top, right, bottom = _label_box(self.text, *self.at)
        return min(max(self.point[0], x_min), right), min(max(self.point[1], top), bottom)


def place_labels(
    named: Sequence[tuple[str, tuple[float, float]]],
    size: tuple[int, int],
    taken: Sequence[Box] = (),
) -> list[PictureLabel]:
    """A label for each name and its point, in a picture of this size; none lies on another or on
    what is `taken`.

    A name for which there is no room near its point is left out.
    """
    boxes, labels = list(taken), []
    for text, point in named:
        for x, y in _label_positions(text, point):
            box = _label_box(text, x, y)
            inside = box[0] >= 0 and box[1] >= 0 and box[2] <= size[0] and box[3] <= size[1]
            if inside and not any(_boxes_overlap(box, placed_box) for placed_box in boxes):
                boxes.append(box)
                labels.append(PictureLabel(text, point, (x, y)))
                break
    return labels


def _label_positions(text: str, point: tuple[float, float]) -> Iterator[tuple[float, float]]:
    """Places for the left end of the base line: first above the point, then farther and farther
    round about it.
    """
    half = WIDTH_PIXELS * len(text) / 2
    for ring in range(LABEL_RINGS):
        away = NEAR_PIXELS + ring * SIZE_PIXELS
        for number in range(LABEL_DIRECTIONS):
            turn = (number + 1) // 2 * (-1) ** number * 2 * math.pi / LABEL_DIRECTIONS - math.pi / 2
            across, down = math.cos(turn), math.sin(turn)
            yield (
                point[0] + across * (away + half) - half,
                point[1] + down * away + SIZE_PIXELS * (1 + down) / 2,
            )


def _label_box(text: str, x: float, y: float) -> Box:
    return x, y - SIZE_PIXELS, x + WIDTH_PIXELS * len(text), y + 3.0


def _boxes_overlap(first: Box, second: Box) -> bool:
    return (
        first[0] < second[2]
        and second[0] < first[2]
        and first[1] < second[3]
        and second[1] < first[3]
    )


RING_PIXELS = 11.0  # radius of the ring around a contact
COARSE_PIXELS = 3  # pixels of the picture to one of those that tell what is seen
KEY_PIXELS = 12  # side of the square that shows a colour
LEGEND_LEFT_PX, LEGEND_TOP_PX, LEGEND_LINE_PX = 16, 14, 20  # of the legend, in pixels


@dataclass(frozen=True, slots=True)
class LegendKey:
    """An entry of the legend: a name, a colour, and the upper left corner of its square."""

    name: str
    colour: Colour
    at: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PictureNotes:
    """Labels, the middles of the rings around contacts, and the legend, all in pixels."""

    labels: tuple[PictureLabel, ...] = ()
    rings: tuple[tuple[float, float], ...] = ()
    legend: tuple[LegendKey, ...] = ()


def picture_notes_of(
    camera: PictureCamera,
    shown: Sequence[PictureSurface],
    carriers: Floats,
    contacts: Sequence[Contact] = (),
) -> PictureNotes:
    """The notes on surfaces whose carriers are at poses (k + 1, 4, 4). Contacts are named first."""
    middles = [
        _to_pixel(camera, (contact.point_first + contact.point_second) / 2) for contact in contacts
    ]
    depths = [
        f"{contact.first} / {contact.second}: {contact.depth_m * 1000:.1f} mm"
        for contact in contacts
    ]
    legend = tuple(_legend_keys({surface.kind for surface in shown}))
    named = [*zip(depths, middles, strict=True), *_names_to_show(camera, shown, carriers)]
    taken = [*map(_ring_box, middles), *map(_key_box, legend)]
    return PictureNotes(
        tuple(place_labels(named, (camera.width, camera.height), taken)), tuple(middles), legend
    )


def _to_pixel(camera: PictureCamera, point: Floats) -> tuple[float, float]:
    x, y, _ = camera.project(point)
    return float(x), float(y)


def _names_to_show(
    camera: PictureCamera, shown: Sequence[PictureSurface], carriers: Floats
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Each body, and each arm as a whole, with the highest point that is seen of it; the highest
    first.

    A body that others hide is named as hidden, at its middle.
    """
    names = [surface.body.partition(".")[0] for surface in shown]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    small = replace(
        camera,
        scale=camera.scale / COARSE_PIXELS,
        width=camera.width // COARSE_PIXELS,
        height=camera.height // COARSE_PIXELS,
    )
    triangles = small.project(triangles_in_world(shown, carriers))
    of = np.repeat([numbers[name] for name in names], [len(surface.triangles) for surface in shown])
    seen = fill(np.full((small.height, small.width), -1), triangles, of)
    highest = {}
    for name, number in numbers.items():
        rows, columns = np.nonzero(seen == number)
        if len(rows):
            top = columns[rows == rows[0]]
            highest[name] = (float(np.median(top)) + 0.5, float(rows[0]))
        else:
            x, y, _ = triangles[of == number].mean(axis=(0, 1))
            highest[f"{name} (hidden)"] = (float(x), float(y))
    for name, (x, y) in sorted(highest.items(), key=lambda entry: entry[1][1]):
        yield name, (x * COARSE_PIXELS, y * COARSE_PIXELS)


def _legend_keys(kinds: set[str]) -> Iterator[LegendKey]:
    for place, (name, colour) in enumerate(
        (name, colour) for name, colour in KIND_COLOURS.items() if name in kinds
    ):
        yield LegendKey(name, colour, (LEGEND_LEFT_PX, LEGEND_TOP_PX + place * LEGEND_LINE_PX))


def _ring_box(middle: tuple[float, float]) -> Box:
    x, y = middle
    return x - RING_PIXELS, y - RING_PIXELS, x + RING_PIXELS, y + RING_PIXELS


def _key_box(key: LegendKey) -> Box:
    x, y = key.at
    return x, y, x + KEY_PIXELS + 8 + WIDTH_PIXELS * len(key.name), y + SIZE_PIXELS + 3
