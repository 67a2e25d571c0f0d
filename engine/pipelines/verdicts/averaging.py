"""Several values of one thing: which agree with each other, and their mean."""

import math
from collections.abc import Sequence

from cellwright.kb.model.conformity import COVERAGE
from cellwright.kb.model.results import Measured

AGREES = 3.0  # standard deviations between two values of the same feature


def sigma_of(measured: Measured) -> float:
    """The standard deviation of a value; 0 if nobody said."""
    return (measured.uncertainty or 0.0) / COVERAGE


def agreeing(values: Sequence[Measured]) -> tuple[tuple[int, ...], ...]:
    """The largest sets of values that agree with each other; several if none is the largest. Without uncertainty the last counts."""
    if len(values) == 1 or not all(map(sigma_of, values)):
        return ((len(values) - 1,),)
    groups = set[tuple[int, ...]]()
    order = sorted(range(len(values)), key=lambda each: values[each].value)
    for place, first in enumerate(order):
        span = [first]
        for other in order[place + 1 :]:
            wide = AGREES * math.hypot(sigma_of(values[first]), sigma_of(values[other]))
            if values[other].value - values[first].value <= wide:
                span.append(other)
        groups.add(tuple(sorted(span)))
    most = max(map(len, groups))
    return tuple(sorted(each for each in groups if len(each) == most))


def mean(values: Sequence[Measured], chosen: Sequence[int]) -> tuple[float, float]:
    """The mean of some values, weighed by their standard deviations, and the standard deviation of it; 0 if none is known."""
    some = [values[each] for each in chosen]
    if not all(map(sigma_of, some)):
        return some[-1].value, 0.0
    weights = [1.0 / sigma_of(each) ** 2 for each in some]
    total = sum(weights)
    return sum(w * each.value for w, each in zip(weights, some, strict=True)) / total, total**-0.5
