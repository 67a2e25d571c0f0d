"""Closed tours under symmetric costs: annealed exchanges, and the bound of Held and Karp."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine.kernels.arrays import Floats, Ints
from engine.kernels.cancellation import Interrupted, never
from engine.stages.sequencing.candidates import nearest, quadrant
from engine.stages.sequencing.limits import Limits

Matrix = Ints  # or of 64 bits, if costs are large
Order = Ints
FEW = 8  # fewer cities are left to the exact methods
SLICE = 4000
WARM, COLD = 0.3, 0.003  # times the mean edge, at the beginning and the end of each annealing
STEPS = 300  # of the ascent if no proof is tried; fewer if each takes long


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """The best order, its cost, and the number of kicks made."""

    order: Order
    cost: int
    work: int


def length(cost: Matrix, order: Order) -> int:
    """The cost of a closed tour."""
    return int(cost[order, np.roll(order, -1)].astype(np.int64).sum())


def search(
    cost: Matrix, start: Order, limits: Limits, positions: NDArray[np.floating] | None = None
) -> Searched:
    """The best closed tour found from `start` (n,), n >= 8.

    Each annealing is twice as long as the one before.
    """
    from engine.stages.sequencing.kernels.kicks import improve

    n = len(cost)
    if limits.interrupted():
        return Searched(start, length(cost, start), 0)
    near = nearest(cost, 8) if positions is None else quadrant(positions, cost)
    toll = np.take_along_axis(cost, near, 1)
    best, _, _, _ = improve(start.copy(), cost, near, toll, 0, 1.0, 1.0, limits.seed)
    total = limits.work or default_work(n)
    done, phase, seed = 0, 20 * n + 2000, limits.seed
    while done < total and not limits.interrupted():
        kicks = min(phase, total - done)
        warmth = WARM * max(length(cost, best), 1) / n
        cooling, tour, left = (COLD / WARM) ** (1 / kicks), best.copy(), kicks
        while left > 0 and not limits.interrupted():
            seed += 1
            now = min(SLICE, left)
            found, _, _, warmth = improve(tour, cost, near, toll, now, warmth, cooling, seed)
            best = found if length(cost, found) < length(cost, best) else best
            left, done = left - now, done + now
        phase *= 2
    return Searched(best, length(cost, best), done)


def default_work(n: int) -> int:
    """The number of kicks that suits n visits: about a second and a half for a thousand."""
    return 20_000 + 40 * n


def bound(cost: Matrix, upper: int, steps: int = 0, interrupted: Interrupted = never) -> tuple[int, Floats]:
    """A lower bound on all closed tours, and the penalties (n,) that prove it; n >= 3.

    If `steps` is 0, their number suits n.
    """
    from engine.stages.sequencing.kernels.bounds import ascend

    steps = steps or max(60, min(STEPS, 400_000 // len(cost)))
    value, penalties, _ = ascend(cost, np.zeros(len(cost)), float(upper), steps, 1.0, interrupted)
    return int(np.ceil(value)), penalties
