"""Relations as equations, with their derivatives, for a batch of B poses of each part at once.

An equation reads two points and two directions in the base's frame. It gives what it lacks (B, m), and the derivatives of
that by each of the four vectors (B, m, 3).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.rigid import skew
from cellwright.engine.model.assembly import Feature, FeatureKind, Relation, RelationKind
from cellwright.engine.model.geometry import Floats

PLANE, LINE, POINT = FeatureKind.PLANE, FeatureKind.LINE, FeatureKind.POINT


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """Two features in the base's frame: points and directions (B, 3) each, and the value of the relation."""

    p: Floats
    d: Floats
    q: Floats
    e: Floats
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Lack:
    """What equations lack (B, m), and its derivatives (B, m, 3) by p, d, q and e."""

    value: Floats
    by_p: Floats
    by_d: Floats
    by_q: Floats
    by_e: Floats


def _lack(value: Floats, p: Floats | None, d: Floats | None, q: Floats | None, e: Floats | None) -> Lack:
    zero = np.zeros((*value.shape, 3))
    return Lack(value, *(zero if each is None else each for each in (p, d, q, e)))


def _identity(like: Floats) -> Floats:
    return np.broadcast_to(np.eye(3), (len(like), 3, 3))


def _same(x: Ends) -> Lack:
    """The directions are equal."""
    one = _identity(x.d)
    return _lack(x.d - x.e, None, one, None, -one)


def _opposite(x: Ends) -> Lack:
    """The directions are opposite."""
    one = _identity(x.d)
    return _lack(x.d + x.e, None, one, None, one)


def _either(x: Ends) -> Lack:
    """The directions are equal or opposite."""
    return _lack(np.cross(x.d, x.e), None, -skew(x.e), None, skew(x.d))


def _cosine(x: Ends, cosine: float) -> Lack:
    value = np.einsum("bi,bi->b", x.d, x.e)[:, None] - cosine
    return _lack(value, None, x.e[:, None], None, x.d[:, None])


def _at_angle(x: Ends) -> Lack:
    """The directions are at an angle. At 0 and half a turn its cosine says too little, so the directions are compared."""
    if np.sin(x.value) ** 2 < 1e-12:
        return _same(x) if np.cos(x.value) > 0 else _opposite(x)
    return _cosine(x, float(np.cos(x.value)))


def _inclined(x: Ends) -> Lack:
    """A line is at an angle to a plane."""
    if np.cos(x.value) ** 2 < 1e-12:
        return _same(x) if np.sin(x.value) > 0 else _opposite(x)
    return _cosine(x, float(np.sin(x.value)))


def _square(x: Ends) -> Lack:
    """The directions are at right angles."""
    return _cosine(x, 0.0)


def _height(x: Ends) -> Lack:
    """The first point is `value` outside the plane of the second feature."""
    apart = x.p - x.q
    value = np.einsum("bi,bi->b", apart, x.e)[:, None] - x.value
    return _lack(value, x.e[:, None], None, -x.e[:, None], apart[:, None])


def _on_line(x: Ends) -> Lack:
    """The first point lies on the line of the second feature."""
    apart, cross = x.p - x.q, skew(x.e)
    return _lack(np.cross(apart, x.e), -cross, None, cross, skew(apart))


def _together(x: Ends) -> Lack:
    """The points coincide."""
    one = _identity(x.p)
    return _lack(x.p - x.q, one, None, -one, None)


def _apart(x: Ends) -> Lack:
    """The points are `value` apart."""
    if x.value == 0.0:
        return _together(x)
    unit, length = _unit(x.p - x.q)
    return _lack(length - x.value, unit[:, None], None, -unit[:, None], None)


def _off_line(x: Ends) -> Lack:
    """The first point is `value` from the line of the second feature."""
    if x.value == 0.0:
        return _on_line(x)
    along = np.einsum("bi,bi->b", x.p - x.q, x.e)[:, None]
    unit, length = _unit(x.p - x.q - along * x.e)
    return _lack(length - x.value, unit[:, None], None, -unit[:, None], -along[:, None] * unit[:, None])


def _unit(vector: Floats) -> tuple[Floats, Floats]:
    """The unit vectors (B, 3) and lengths (B, 1)."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return vector / np.where(length > 1e-12, length, 1.0), length


Equation = Callable[[Ends], Lack]
K = RelationKind
EQUATIONS: dict[tuple[RelationKind, FeatureKind, FeatureKind], tuple[Equation, ...]] = {
    (K.PARALLEL, PLANE, PLANE): (_either,),
    (K.PARALLEL, LINE, LINE): (_either,),
    (K.PARALLEL, LINE, PLANE): (_square,),
    (K.AGAINST, PLANE, PLANE): (_opposite, _height),
    (K.AGAINST, LINE, PLANE): (_square, _height),
    (K.AGAINST, POINT, PLANE): (_height,),
    (K.COPLANAR, PLANE, PLANE): (_same, _height),
    (K.COPLANAR, LINE, PLANE): (_square, _height),
    (K.COPLANAR, POINT, PLANE): (_height,),
    (K.ALIGNED, LINE, LINE): (_either, _on_line),
    (K.ALIGNED, POINT, LINE): (_on_line,),
    (K.FITS, LINE, LINE): (_opposite, _on_line),
    (K.CONCENTRIC, LINE, LINE): (_either, _on_line),
    (K.CONCENTRIC, POINT, LINE): (_on_line,),
    (K.CONCENTRIC, POINT, POINT): (_together,),
    (K.DISTANCE, PLANE, PLANE): (_either, _height),
    (K.DISTANCE, LINE, PLANE): (_square, _height),
    (K.DISTANCE, POINT, PLANE): (_height,),
    (K.DISTANCE, LINE, LINE): (_either, _off_line),
    (K.DISTANCE, POINT, LINE): (_off_line,),
    (K.DISTANCE, POINT, POINT): (_apart,),
    (K.ANGLE, PLANE, PLANE): (_at_angle,),
    (K.ANGLE, LINE, LINE): (_at_angle,),
    (K.ANGLE, LINE, PLANE): (_inclined,),
}
"""What holds between two features, by the kind of the relation and of the features. Either feature may come first."""


def in_order(relation: Relation) -> tuple[Feature, Feature]:
    """The features of a relation in the order of the table. Raises `ValueError` for features that it does not join."""
    for one, other in ((relation.first, relation.second), (relation.second, relation.first)):
        if (relation.kind, one.kind, other.kind) in EQUATIONS:
            return one, other
    first, second = relation.first.kind.value, relation.second.kind.value
    raise ValueError(f"'{relation}': {relation.kind.value} does not join a {first} and a {second}")


def lack(relation: Relation, poses: Floats, at: tuple[int, int], size_m: float) -> tuple[Floats, Floats]:
    """What a relation lacks (B, m), and its derivatives (B, m, 6 n), for poses (B, n, 4, 4) of n parts.

    Parts number `at` have the features, in the order of `in_order`. Lengths count in `size_m`. Derivatives are by a
    displacement (3) and a turn (3) of each part about its own origin, along the axes of the base.
    """
    one, other = in_order(relation)
    p, d, arm_p = _placed(one, poses[:, at[0]], size_m)
    q, e, arm_q = _placed(other, poses[:, at[1]], size_m)
    value = relation.value / size_m if relation.kind is RelationKind.DISTANCE else relation.value
    ends = Ends(p, d, q, e, value)
    lacks = [each(ends) for each in EQUATIONS[relation.kind, one.kind, other.kind]]
    rows = np.concatenate([each.value for each in lacks], axis=1)
    by = np.zeros((*rows.shape, 6 * poses.shape[1]))
    for n, by_point, by_direction, arm, direction in (
        (at[0], [each.by_p for each in lacks], [each.by_d for each in lacks], arm_p, d),
        (at[1], [each.by_q for each in lacks], [each.by_e for each in lacks], arm_q, e),
    ):
        point, line = np.concatenate(by_point, axis=1), np.concatenate(by_direction, axis=1)
        by[:, :, 6 * n : 6 * n + 3] += point
        by[:, :, 6 * n + 3 : 6 * n + 6] -= point @ skew(arm) + line @ skew(direction)
    return rows, by


def _placed(feature: Feature, poses: Floats, size_m: float) -> tuple[Floats, Floats, Floats]:
    """Points and directions of a feature in the base's frame, and the way from the part's origin (B, 3 each)."""
    R = poses[:, :3, :3]
    arm = R @ feature.point / size_m
    return arm + poses[:, :3, 3], R @ feature.direction, arm
