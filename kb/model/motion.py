"""How long an arm takes from place to place: straight lines at one speed, as a domain declares it.

All points are in whole micrometres, so every part of the engine computes the same whole number of units of time.
"""

import math
from dataclasses import dataclass, field
from fractions import Fraction

from cellwright.kb.diagnostics import NOWHERE, Source

Point = tuple[int, int, int]  # micrometres

DISTANCE = "distance"  # what durations and costs call the length of a way


@dataclass(frozen=True, slots=True)
class Motion:
    """Straight ways at `speed`, in micrometres per unit of the domain's time, which is greater than 0.

    Each way between two different places takes `settling` units more. Points are in the frame `frame` of the cell.
    """

    speed: Fraction
    settling: Fraction = Fraction(0)
    frame: str = "world"
    where: Source = field(default=NOWHERE, compare=False)

    def time(self, here: Point, there: Point) -> int:
        """The time from one place to another one, in the domain's unit, rounded up to a whole number."""
        first, scale = self.settling.numerator * self.speed.numerator, self.settling.denominator
        squared = _squared(here, there) * (self.speed.denominator * scale) ** 2
        root = math.isqrt(squared)
        below = root - 1 if root * root == squared else root  # the greatest whole number below the exact root
        return (below + first) // (self.speed.numerator * scale) + 1


def distance(here: Point, there: Point) -> int:
    """The straight way between two points, rounded to whole micrometres."""
    return (math.isqrt(4 * _squared(here, there)) + 1) // 2


def _squared(here: Point, there: Point) -> int:
    return sum((one - other) ** 2 for one, other in zip(here, there, strict=True))
