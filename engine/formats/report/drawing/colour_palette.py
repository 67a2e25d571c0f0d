"""Colours that can be told apart; within one picture none is used twice while there are enough."""

import colorsys
import itertools
from collections.abc import Iterable

FIRST_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#b8860b",
    "#56b4e9",
    "#7f3c8d",
    "#666666",
)
GOLDEN_TURN = 0.618034  # of a turn: hues at this distance spread evenly, however many there are
MAX_COLOURS = 500  # colours; beyond, nobody tells them apart, and they are used again in turn
SHADES = ((0.35, 0.75), (0.55, 0.55), (0.25, 0.6), (0.45, 0.9))  # lightness and saturation, in turn


def assign_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour of its own for each of the first names, in their order.

    The first eight suit colour-blind readers.
    """
    distinct_names = list(dict.fromkeys(names))
    chosen_colours = dict.fromkeys(FIRST_COLOURS)
    number = 0
    while len(chosen_colours) < min(len(distinct_names), MAX_COLOURS):
        lightness, saturation = SHADES[number % len(SHADES)]
        chosen_colours[
            _hex_colour(colorsys.hls_to_rgb(number * GOLDEN_TURN % 1.0, lightness, saturation))
        ] = None
        number += 1
    return dict(zip(distinct_names, itertools.cycle(chosen_colours), strict=False))


def _hex_colour(parts: tuple[float, float, float]) -> str:
    """The colour of red, green and blue from 0 to 1, as SVG writes it."""
    return "#{:02x}{:02x}{:02x}".format(*(round(255 * part) for part in parts))
