"""What is written into a picture: the names of bodies, the depths of contacts, and the meaning of colours."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Contact, Floats
from cellwright.engine.stages.geometry.pictures.camera import Camera, triangles_in_world
from cellwright.engine.stages.geometry.pictures.labels import SIZE_PIXELS, WIDTH_PIXELS, Box, Label, placed
from cellwright.engine.stages.geometry.pictures.raster import fill
from cellwright.engine.stages.geometry.pictures.surfaces import KINDS, Colour, Surface

RING_PIXELS = 11.0  # radius of the ring around a contact
COARSE = 3  # pixels of the picture to one of those that tell what is seen
KEY_PIXELS = 12  # side of the square that shows a colour
LEFT, TOP, LINE = 16, 14, 20  # of the legend, in pixels


@dataclass(frozen=True, slots=True)
class Key:
    """An entry of the legend: a name, a colour, and the upper left corner of its square."""

    name: str
    colour: Colour
    at: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Notes:
    """Labels, the middles of the rings around contacts, and the legend, all in pixels."""

    labels: tuple[Label, ...] = ()
    rings: tuple[tuple[float, float], ...] = ()
    legend: tuple[Key, ...] = ()


def notes_of(
    camera: Camera, shown: Sequence[Surface], carriers: Floats, contacts: Sequence[Contact] = ()
) -> Notes:
    """The notes on surfaces whose carriers are at poses (k + 1, 4, 4). Contacts are named first."""
    middles = [_pixel(camera, (each.point_first + each.point_second) / 2) for each in contacts]
    said = [f"{each.first} / {each.second}: {each.depth_m * 1000:.1f} mm" for each in contacts]
    legend = tuple(_legend({each.kind for each in shown}))
    named = [*zip(said, middles, strict=True), *_names(camera, shown, carriers)]
    taken = [*map(_ring_box, middles), *map(_key_box, legend)]
    return Notes(tuple(placed(named, (camera.width, camera.height), taken)), tuple(middles), legend)


def _pixel(camera: Camera, point: Floats) -> tuple[float, float]:
    x, y, _ = camera.project(point)
    return float(x), float(y)


def _names(
    camera: Camera, shown: Sequence[Surface], carriers: Floats
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Each body, and each arm as a whole, with the highest point that is seen of it; the highest first.

    A body that others hide is named as hidden, at its middle.
    """
    names = [each.body.partition(".")[0] for each in shown]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    small = replace(
        camera, scale=camera.scale / COARSE, width=camera.width // COARSE, height=camera.height // COARSE
    )
    triangles = small.project(triangles_in_world(shown, carriers))
    of = np.repeat([numbers[name] for name in names], [len(each.triangles) for each in shown])
    seen = fill(np.full((small.height, small.width), -1), triangles, of)
    found = {}
    for name, number in numbers.items():
        rows, columns = np.nonzero(seen == number)
        if len(rows):
            top = columns[rows == rows[0]]
            found[name] = (float(np.median(top)) + 0.5, float(rows[0]))
        else:
            x, y, _ = triangles[of == number].mean(axis=(0, 1))
            found[f"{name} (hidden)"] = (float(x), float(y))
    for name, (x, y) in sorted(found.items(), key=lambda each: each[1][1]):
        yield name, (x * COARSE, y * COARSE)


def _legend(kinds: set[str]) -> Iterator[Key]:
    for place, (name, colour) in enumerate((name, colour) for name, colour in KINDS.items() if name in kinds):
        yield Key(name, colour, (LEFT, TOP + place * LINE))


def _ring_box(middle: tuple[float, float]) -> Box:
    x, y = middle
    return x - RING_PIXELS, y - RING_PIXELS, x + RING_PIXELS, y + RING_PIXELS


def _key_box(key: Key) -> Box:
    x, y = key.at
    return x, y, x + KEY_PIXELS + 8 + WIDTH_PIXELS * len(key.name), y + SIZE_PIXELS + 3
