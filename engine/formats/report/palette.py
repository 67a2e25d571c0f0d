"""Colours that can be told apart: within one picture none is used twice, as far as there are enough."""

import colorsys
import itertools
from collections.abc import Iterable

FIRST = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#7f3c8d", "#666666")
GOLDEN = 0.618034  # of a turn: hues at this distance spread evenly, however many there are
MOST = 500  # colours; beyond, nobody tells them apart, and they are used again in turn
SHADES = ((0.35, 0.75), (0.55, 0.55), (0.25, 0.6), (0.45, 0.9))  # lightness and saturation, in turn


def colours(names: Iterable[str]) -> dict[str, str]:
    """A colour of its own for each of the first names, in their order. The first eight suit colour-blind readers."""
    wanted = list(dict.fromkeys(names))
    made = dict.fromkeys(FIRST)
    number = 0
    while len(made) < min(len(wanted), MOST):
        lightness, saturation = SHADES[number % len(SHADES)]
        made[_hex(colorsys.hls_to_rgb(number * GOLDEN % 1.0, lightness, saturation))] = None
        number += 1
    return dict(zip(wanted, itertools.cycle(made), strict=False))


def _hex(parts: tuple[float, float, float]) -> str:
    """The colour of red, green and blue from 0 to 1, as SVG writes it."""
    return "#{:02x}{:02x}{:02x}".format(*(round(255 * part) for part in parts))
