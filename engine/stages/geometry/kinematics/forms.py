"""Which closed form the axes of an arm have at its zero configuration."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm, solved
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms

NEAR = 1e-9  # metres, or sines: axes that miss each other by less meet, or are parallel
PROBED = 0.7  # rad: a form must hold for this value of a joint, and for the negative one


class Solver(Enum):
    """How an arm's inverse kinematics is computed."""

    SPHERICAL_WRIST = "spherical wrist"
    INTERSECTING_AXES = "two axes that meet, and a spherical wrist"
    PARALLEL_AXES = "three parallel axes"
    ITERATIVE = "damped least squares"


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """Six axes at the zero configuration: directions (6, 3), a point on each (6, 3), and the point the last ones share.

    With `backwards` they are those from the hand to the base, and their angles come in that order.
    """

    solver: Solver
    directions: Floats
    points: Floats
    centre: Floats
    backwards: bool = False


def form_of(h: Floats, o: Floats) -> Form | None:
    """The closed form of axes h (6, 3) through points o (6, 3), read from either end; None if they have none."""
    found = _forwards(h, o)
    if found is None:
        found = _forwards(np.ascontiguousarray(-h[::-1]), np.ascontiguousarray(o[::-1]))
        return replace(found, backwards=True) if found else None
    return found


def _forwards(h: Floats, o: Floats) -> Form | None:
    wrist = _common_point(h[3:], o[3:])
    if wrist is not None and _parallel(h[1], h[2]):
        return Form(Solver.SPHERICAL_WRIST, h, o, wrist)
    shoulder = _common_point(h[:2], o[:2])
    if wrist is not None and shoulder is not None:
        return Form(Solver.INTERSECTING_AXES, h, np.array([shoulder, shoulder, *o[2:]]), wrist)
    hand = _common_point(h[4:], o[4:])
    if hand is not None and _parallel(h[1], h[2]) and _parallel(h[2], h[3]):
        return Form(Solver.PARALLEL_AXES, h, o, hand)
    return None


def holdable(h: Floats, o: Floats) -> int | None:
    """The joint of seven that can be held so that the others have a closed form whatever its value; None if there is none.

    Of several it is the third, with which the elbow turns about the line from shoulder to wrist, else the last one.
    """
    for joint in (2, 6, 5, 4, 3, 1, 0):
        if all(form is not None for form in _probed(h, o, joint)):
            return joint
    return None


def _probed(h: Floats, o: Floats, joint: int) -> Iterator[Form | None]:
    for value in (PROBED, -PROBED):
        yield form_of(*_without(h, o, joint, value)[:2])


def held(h: Floats, o: Floats, joint: int, value: float) -> tuple[Form | None, Floats]:
    """The form of seven axes with one joint held (None if there is none), and the matrix (4, 4) to put behind E.

    E = A M B, where M is what the held joint does; as M B = B' M with the axes behind it displaced by M, A B' = E M^-1.
    """
    directions, points, M = _without(h, o, joint, value)
    return form_of(directions, points), transforms.inverse(M)


def _without(h: Floats, o: Floats, joint: int, value: float) -> tuple[Floats, Floats, Floats]:
    R = transforms.rotation(h[joint], value)
    M = transforms.transform(R, o[joint] - matmul(R, o[joint]))
    behind = np.arange(7) > joint
    directions = np.where(behind[:, None], matmul(h, R.T), h)
    points = np.where(behind[:, None], transforms.apply(M, o), o)
    return np.delete(directions, joint, axis=0), np.delete(points, joint, axis=0), M


def _parallel(a: Floats, b: Floats) -> bool:
    return bool(norm(np.cross(a, b)) < NEAR)


def _common_point(h: Floats, o: Floats) -> Floats | None:
    """The point on all lines, if there is exactly one: least squares over their planes."""
    across = np.eye(3) - h[:, :, None] * h[:, None, :]
    system = across.sum(axis=0)
    if np.linalg.eigvalsh(system)[0] < NEAR:
        return None
    point: Floats = solved(system, np.einsum("kij,kj->i", across, o))
    missed = np.linalg.norm(np.einsum("kij,kj->ki", across, point - o), axis=1)
    return point if missed.max() < NEAR else None
