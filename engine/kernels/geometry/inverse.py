# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Closed-form inverse kinematics of six revolute axes, one pose after the other, all eight
branches.

The arm is given at its zero configuration: unit axes h (6, 3) and a point o (6, 3) on each. The
target is E = T(q) T(0)^-1, so E = exp(h1, o1, q1) ... exp(h6, o6, q6). The angles fall out of two
canonical problems in turn: turning a vector onto another and turning it until it meets a plane. No
axis needs to meet the base axis, and the three wrist axes may stand at any angles, so that
orthogonal and three-roll wrists are one case.
"""

import math

import cython

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import angles, subproblems, vectors
from cellwright.engine.kernels.geometry.vectors import V

INFINITE = math.inf


class Batch:
    """Targets E of an arm and their branches; made once for a batch."""

    def __init__(
        self, h: Floats, o: Floats, centre: V, poses: Floats, q: Floats, valid: Floats
    ) -> None:
        """Takes h (6, 3), o (6, 3), the point that the last axes share, and poses E (n, 4, 4);
        written are q (n, 8, 6) and valid (n, 8): 1 or 0. Raises `ValueError` for other arrays.
        """
        self.h, self.o, self.poses, self.q, self.valid = h, o, poses, q, valid
        self.x, self.y, self.z = centre
        self.count = self.poses.shape[0]
        if not _fits(self):
            raise ValueError(
                "axes and points must be (6, 3), E (n, 4, 4), q (n, 8, 6), valid (n, 8): E is "
                f"{poses.shape}"
            )


def _fits(e: Batch) -> bool:
    arm = e.h.shape[0] == e.o.shape[0] == 6 and e.h.shape[1] == e.o.shape[1] == 3
    poses = e.poses.shape[1] == 4 and e.poses.shape[2] == 4
    q = e.q.shape[0] == e.count and e.q.shape[1] == 8 and e.q.shape[2] == 6
    fits: bool = arm and poses and q and e.valid.shape[0] == e.count and e.valid.shape[1] == 8
    return fits


def axis(e: Batch, joint: int) -> V:
    """The axis of a joint, counted from 1."""
    return (e.h[joint - 1, 0], e.h[joint - 1, 1], e.h[joint - 1, 2])


def point(e: Batch, joint: int) -> V:
    """The point on the axis of a joint, counted from 1."""
    return (e.o[joint - 1, 0], e.o[joint - 1, 1], e.o[joint - 1, 2])


def rotate(e: Batch, n: int, v: V) -> V:
    """The rotation in target `n` applied to `v`."""
    return (
        e.poses[n, 0, 0] * v[0] + e.poses[n, 0, 1] * v[1] + e.poses[n, 0, 2] * v[2],
        e.poses[n, 1, 0] * v[0] + e.poses[n, 1, 1] * v[1] + e.poses[n, 1, 2] * v[2],
        e.poses[n, 2, 0] * v[0] + e.poses[n, 2, 1] * v[1] + e.poses[n, 2, 2] * v[2],
    )


def rotate_back(e: Batch, n: int, v: V) -> V:
    """The inverse rotation in target `n` applied to `v`."""
    return (
        e.poses[n, 0, 0] * v[0] + e.poses[n, 1, 0] * v[1] + e.poses[n, 2, 0] * v[2],
        e.poses[n, 0, 1] * v[0] + e.poses[n, 1, 1] * v[1] + e.poses[n, 2, 1] * v[2],
        e.poses[n, 0, 2] * v[0] + e.poses[n, 1, 2] * v[1] + e.poses[n, 2, 2] * v[2],
    )


def moved(e: Batch, n: int, v: V) -> V:
    """The point `v` displaced by target `n`."""
    shift = vectors.vector(e.poses[n, 0, 3], e.poses[n, 1, 3], e.poses[n, 2, 3])
    return vectors.plus(rotate(e, n, v), shift)


def centre_of(e: Batch) -> V:
    """The point that the last axes share."""
    return (e.x, e.y, e.z)


def spherical_wrist(e: Batch) -> None:
    """Axes 2 and 3 parallel, axes 4 to 6 through the centre: fill all branches."""
    with cython.nogil:
        for n in range(e.count):
            _spherical_wrist(e, n)


def _spherical_wrist(e: Batch, n: int) -> None:
    h1, h2, h3, o1, o2, o3 = (
        axis(e, 1),
        axis(e, 2),
        axis(e, 3),
        point(e, 1),
        point(e, 2),
        point(e, 3),
    )
    centre = centre_of(e)
    upper, fore = vectors.minus(o3, o2), vectors.minus(centre, o3)
    target = vectors.minus(moved(e, n, centre), o1)
    first = subproblems.angles_to_plane(
        h2, vectors.times(-1.0, h1), target, vectors.dot(h2, vectors.minus(centre, o1))
    )
    for i in range(2):
        base = first[0] if i == 0 else first[1]
        end = vectors.minus(vectors.turn(h1, -base, target), vectors.minus(o2, o1))
        third = subproblems.angles_to_plane(
            upper,
            h3,
            fore,
            (vectors.dot(end, end) - vectors.dot(upper, upper) - vectors.dot(fore, fore)) / 2.0,
        )
        for j in range(2):
            elbow = third[0] if j == 0 else third[1]
            second = subproblems.angle_onto(
                h2, vectors.plus(upper, vectors.turn(h3, elbow, fore)), end
            )
            b = 4 * i + 2 * j
            for k in range(2):
                e.q[n, b + k, 0], e.q[n, b + k, 1], e.q[n, b + k, 2] = base, second, elbow
            solved = first[2] * third[2] * _wrist(e, n, b)
            e.valid[n, b] = solved
            e.valid[n, b + 1] = solved


def intersecting_axes(e: Batch) -> None:
    """Axes 1 and 2 through `o1`, axes 4 to 6 through the centre: fill all branches (Elias & Wen
    2022, section 4).
    """
    with cython.nogil:
        for n in range(e.count):
            _intersecting_axes(e, n)


def _intersecting_axes(e: Batch, n: int) -> None:
    h1, h2, h3, o1, o3 = axis(e, 1), axis(e, 2), axis(e, 3), point(e, 1), point(e, 3)
    centre = centre_of(e)
    upper, fore, target = (
        vectors.minus(o3, o1),
        vectors.minus(centre, o3),
        vectors.minus(moved(e, n, centre), o1),
    )
    third = subproblems.angles_to_plane(
        upper,
        h3,
        fore,
        (vectors.dot(target, target) - vectors.dot(upper, upper) - vectors.dot(fore, fore)) / 2.0,
    )
    for i in range(2):
        elbow = third[0] if i == 0 else third[1]
        reached = vectors.plus(upper, vectors.turn(h3, elbow, fore))
        second = subproblems.angles_to_plane(h1, h2, reached, vectors.dot(h1, target))
        for j in range(2):
            bend = second[0] if j == 0 else second[1]
            base = subproblems.angle_onto(h1, vectors.turn(h2, bend, reached), target)
            b = 4 * i + 2 * j
            for k in range(2):
                e.q[n, b + k, 0], e.q[n, b + k, 1], e.q[n, b + k, 2] = base, bend, elbow
            solved = third[2] * second[2] * _wrist(e, n, b)
            e.valid[n, b] = solved
            e.valid[n, b + 1] = solved


def _wrist(e: Batch, n: int, b: int) -> float:
    """Fill the last three joints of two branches whose first three are known; whether the wrist
    can turn so far.
    """
    h4, h5, h6 = axis(e, 4), axis(e, 5), axis(e, 6)
    tool = _back(e, n, b, rotate(e, n, h6))  # R36 h6
    fifth = subproblems.angles_to_angle(h4, h5, h6, tool)
    aside = _across(h6)
    turned = _back(e, n, b, rotate(e, n, aside))  # R36 aside
    for k in range(2):
        bend = fifth[0] if k == 0 else fifth[1]
        fourth = subproblems.angle_onto(h4, vectors.turn(h5, bend, h6), tool)
        sixth = subproblems.angle_onto(
            h6, aside, vectors.turn(h5, -bend, vectors.turn(h4, -fourth, turned))
        )
        e.q[n, b + k, 3], e.q[n, b + k, 4], e.q[n, b + k, 5] = fourth, bend, sixth
    return fifth[2]


def _back(e: Batch, n: int, b: int, v: V) -> V:
    """`v` seen after the first three joints."""
    once = vectors.turn(axis(e, 1), -e.q[n, b, 0], v)
    return vectors.turn(axis(e, 3), -e.q[n, b, 2], vectors.turn(axis(e, 2), -e.q[n, b, 1], once))


def _across(axis: V) -> V:
    """Some vector that is not along `axis`, at right angles to it."""
    if abs(axis[0]) < 0.6:
        return vectors.cross(axis, vectors.vector(1.0, 0.0, 0.0))
    return vectors.cross(axis, vectors.vector(0.0, 1.0, 0.0))


def parallel_axes(e: Batch) -> None:
    """Axes 2, 3 and 4 parallel, axes 5 and 6 through the centre: fill all branches."""
    with cython.nogil:
        for n in range(e.count):
            _parallel_axes(e, n)


def _parallel_axes(e: Batch, n: int) -> None:
    h1, h2, h5, h6, o1, centre = (
        axis(e, 1),
        axis(e, 2),
        axis(e, 5),
        axis(e, 6),
        point(e, 1),
        centre_of(e),
    )
    target = vectors.minus(moved(e, n, centre), o1)
    first = subproblems.angles_to_plane(
        h2, vectors.times(-1.0, h1), target, vectors.dot(h2, vectors.minus(centre, o1))
    )
    for i in range(2):
        base = first[0] if i == 0 else first[1]
        wrist = vectors.turn(h1, -base, target)
        tool = vectors.turn(h1, -base, rotate(e, n, h6))
        fifth = subproblems.angles_to_angle(h2, h5, h6, tool)
        for k in range(2):
            b, bend = 4 * i + 2 * k, fifth[0] if k == 0 else fifth[1]
            for j in range(2):
                e.q[n, b + j, 0], e.q[n, b + j, 4] = base, bend
            solved = first[2] * fifth[2] * _elbow(e, n, b, wrist)
            e.valid[n, b] = solved
            e.valid[n, b + 1] = solved


def _elbow(e: Batch, n: int, b: int, wrist: V) -> float:
    """Fill joints 2, 3, 4 and 6 of two branches whose joints 1 and 5 are known; whether the arm
    is long enough.
    """
    h2, h3, o2, o3, o4 = axis(e, 2), axis(e, 3), point(e, 2), point(e, 3), point(e, 4)
    whole, palm = (
        vectors.minus(wrist, vectors.minus(o2, point(e, 1))),
        vectors.minus(centre_of(e), o4),
    )
    total, sixth = _hand(e, n, b, whole, palm)
    end = vectors.minus(whole, vectors.turn(h2, total, palm))
    upper, fore = vectors.minus(o3, o2), vectors.minus(o4, o3)
    third = subproblems.angles_to_plane(
        upper,
        h3,
        fore,
        (vectors.dot(end, end) - vectors.dot(upper, upper) - vectors.dot(fore, fore)) / 2.0,
    )
    for j in range(2):
        bend = third[0] if j == 0 else third[1]
        second = subproblems.angle_onto(h2, vectors.plus(upper, vectors.turn(h3, bend, fore)), end)
        rest = total - second - vectors.dot(h2, h3) * bend
        e.q[n, b + j, 1], e.q[n, b + j, 2] = second, bend
        e.q[n, b + j, 3], e.q[n, b + j, 5] = vectors.dot(h2, axis(e, 4)) * rest, sixth
    return third[2]


def _hand(e: Batch, n: int, b: int, whole: V, palm: V) -> tuple[float, float]:
    """How far joints 2, 3 and 4 turn together about axis 2, and joint 6."""
    h1, h2, h5, h6, q1, q5 = (
        axis(e, 1),
        axis(e, 2),
        axis(e, 5),
        axis(e, 6),
        e.q[n, b, 0],
        e.q[n, b, 4],
    )
    parallel = vectors.turn(h5, -q5, h2)
    beside = vectors.cross(parallel, h6)
    if vectors.dot(beside, beside) > subproblems.ALONG:
        # h2^T R1^T R06 = h2^T R5 R6, so that R6 turns R06^T R1 h2 onto R5^T h2
        sixth = subproblems.angle_onto(h6, rotate_back(e, n, vectors.turn(h1, q1, h2)), parallel)
        aside = _across(h2)
        seen = vectors.turn(h6, -sixth, vectors.turn(h5, -q5, aside))
        return (subproblems.angle_onto(h2, aside, vectors.turn(h1, -q1, rotate(e, n, seen))), sixth)
    # axis 6 is parallel to axis 4: of the continuum the hand that reaches farthest
    total = subproblems.angle_onto(h2, palm, whole)
    aside = _across(h6)
    seen = vectors.turn(h2, -total, vectors.turn(h1, -q1, rotate(e, n, aside)))
    return (total, subproblems.angle_onto(h6, aside, vectors.turn(h5, -q5, seen)))


def residuals(e: Batch, out: Floats) -> None:
    """How far each valid branch misses E, in metres and radians alike: out (n, 8), infinite where
    not valid.

    Raises `ValueError` for another array.
    """
    missed = out
    if missed.shape[0] != e.count or missed.shape[1] != 8:
        raise ValueError(f"residuals must be ({e.count}, 8), not {out.shape}")
    with cython.nogil:
        for n in range(e.count):
            for b in range(8):
                missed[n, b] = INFINITE
                if e.valid[n, b] > 0.0:
                    missed[n, b] = _residual(e, n, b)


def _residual(e: Batch, n: int, b: int) -> float:
    """The largest error of the images of three unit steps from the origin, and of the origin."""
    x, y = vectors.vector(1.0, 0.0, 0.0), vectors.vector(0.0, 1.0, 0.0)
    z, origin = vectors.vector(0.0, 0.0, 1.0), vectors.vector(0.0, 0.0, 0.0)
    end_x, end_y, end_z, end_origin = (
        moved(e, n, x),
        moved(e, n, y),
        moved(e, n, z),
        moved(e, n, origin),
    )
    for joint in range(6, 0, -1):
        h, o, angle = axis(e, joint), point(e, joint), e.q[n, b, joint - 1]
        s, c = angles.sine_cosine(angle)
        x = vectors.plus(o, vectors.turn_by(h, s, c, vectors.minus(x, o)))
        y = vectors.plus(o, vectors.turn_by(h, s, c, vectors.minus(y, o)))
        z = vectors.plus(o, vectors.turn_by(h, s, c, vectors.minus(z, o)))
        origin = vectors.plus(o, vectors.turn_by(h, s, c, vectors.minus(origin, o)))
    worst = _largest(0.0, vectors.minus(x, end_x))
    worst = _largest(worst, vectors.minus(y, end_y))
    worst = _largest(worst, vectors.minus(z, end_z))
    return _largest(worst, vectors.minus(origin, end_origin))


def _largest(worst: float, v: V) -> float:
    """The largest of a number and the sizes of the entries."""
    return max(worst, abs(v[0]), abs(v[1]), abs(v[2]))
