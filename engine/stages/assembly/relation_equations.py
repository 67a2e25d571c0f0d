"""Spatial relations as equations with derivatives, and a solver for the parts' poses.

An equation reads two points and two directions in the base's frame. It gives what it lacks (B, m),
and the derivatives of that by each of the four vectors (B, m, 3).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation_by_vector, skew
from cellwright.engine.model.manipulation_values import (
    FeatureKind,
    PartFeature,
    Relation,
    RelationKind,
)

PLANE, LINE, POINT = FeatureKind.PLANE, FeatureKind.LINE, FeatureKind.POINT


@dataclass(frozen=True, slots=True, eq=False)
class FeatureEnds:
    """Two features in the base's frame: points and directions (B, 3) each, and the value of the
    relation.
    """

    p: Floats
    d: Floats
    q: Floats
    e: Floats
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """What equations lack (B, m), and its derivatives (B, m, 3) by p, d, q and e."""

    value: Floats
    by_p: Floats
    by_d: Floats
    by_q: Floats
    by_e: Floats


def _residual(
    value: Floats, p: Floats | None, d: Floats | None, q: Floats | None, e: Floats | None
) -> Residual:
    zero = np.zeros((*value.shape, 3))
    return Residual(
        value, *(zero if derivative is None else derivative for derivative in (p, d, q, e))
    )


def _identity_like(like: Floats) -> Floats:
    return np.broadcast_to(np.eye(3), (len(like), 3, 3))


def _same_direction(x: FeatureEnds) -> Residual:
    """The directions are equal."""
    identity = _identity_like(x.d)
    return _residual(x.d - x.e, None, identity, None, -identity)


def _opposite_direction(x: FeatureEnds) -> Residual:
    """The directions are opposite."""
    identity = _identity_like(x.d)
    return _residual(x.d + x.e, None, identity, None, identity)


def _parallel_direction(x: FeatureEnds) -> Residual:
    """The directions are equal or opposite."""
    return _residual(np.cross(x.d, x.e), None, -skew(x.e), None, skew(x.d))


def _cosine_residual(x: FeatureEnds, cosine: float) -> Residual:
    value = np.einsum("bi,bi->b", x.d, x.e)[:, None] - cosine
    return _residual(value, None, x.e[:, None], None, x.d[:, None])


def _at_angle(x: FeatureEnds) -> Residual:
    """The directions are at an angle.

    At 0 and half a turn its cosine says too little, so the directions are compared.
    """
    if np.sin(x.value) ** 2 < 1e-12:
        return _same_direction(x) if np.cos(x.value) > 0 else _opposite_direction(x)
    return _cosine_residual(x, float(np.cos(x.value)))


def _angle_to_plane(x: FeatureEnds) -> Residual:
    """A line is at an angle to a plane."""
    if np.cos(x.value) ** 2 < 1e-12:
        return _same_direction(x) if np.sin(x.value) > 0 else _opposite_direction(x)
    return _cosine_residual(x, float(np.sin(x.value)))


def _right_angle(x: FeatureEnds) -> Residual:
    """The directions are at right angles."""
    return _cosine_residual(x, 0.0)


def _height_above_plane(x: FeatureEnds) -> Residual:
    """The first point is `value` outside the plane of the second feature."""
    apart = x.p - x.q
    value = np.einsum("bi,bi->b", apart, x.e)[:, None] - x.value
    return _residual(value, x.e[:, None], None, -x.e[:, None], apart[:, None])


def _on_line(x: FeatureEnds) -> Residual:
    """The first point lies on the line of the second feature."""
    apart, cross = x.p - x.q, skew(x.e)
    return _residual(np.cross(apart, x.e), -cross, None, cross, skew(apart))


def _points_coincide(x: FeatureEnds) -> Residual:
    """The points coincide."""
    identity = _identity_like(x.p)
    return _residual(x.p - x.q, identity, None, -identity, None)


def _points_apart(x: FeatureEnds) -> Residual:
    """The points are `value` apart."""
    if x.value == 0.0:
        return _points_coincide(x)
    unit, length = _unit_vectors(x.p - x.q)
    return _residual(length - x.value, unit[:, None], None, -unit[:, None], None)


def _off_line(x: FeatureEnds) -> Residual:
    """The first point is `value` from the line of the second feature."""
    if x.value == 0.0:
        return _on_line(x)
    along = np.einsum("bi,bi->b", x.p - x.q, x.e)[:, None]
    unit, length = _unit_vectors(x.p - x.q - along * x.e)
    return _residual(
        length - x.value, unit[:, None], None, -unit[:, None], -along[:, None] * unit[:, None]
    )


def _unit_vectors(vector: Floats) -> tuple[Floats, Floats]:
    """The unit vectors (B, 3) and lengths (B, 1)."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return vector / np.where(length > 1e-12, length, 1.0), length


Equation = Callable[[FeatureEnds], Residual]
K = RelationKind
RELATION_EQUATIONS: dict[tuple[RelationKind, FeatureKind, FeatureKind], tuple[Equation, ...]] = {
    (K.PARALLEL, PLANE, PLANE): (_parallel_direction,),
    (K.PARALLEL, LINE, LINE): (_parallel_direction,),
    (K.PARALLEL, LINE, PLANE): (_right_angle,),
    (K.AGAINST, PLANE, PLANE): (_opposite_direction, _height_above_plane),
    (K.AGAINST, LINE, PLANE): (_right_angle, _height_above_plane),
    (K.AGAINST, POINT, PLANE): (_height_above_plane,),
    (K.COPLANAR, PLANE, PLANE): (_same_direction, _height_above_plane),
    (K.COPLANAR, LINE, PLANE): (_right_angle, _height_above_plane),
    (K.COPLANAR, POINT, PLANE): (_height_above_plane,),
    (K.ALIGNED, LINE, LINE): (_parallel_direction, _on_line),
    (K.ALIGNED, POINT, LINE): (_on_line,),
    (K.FITS, LINE, LINE): (_opposite_direction, _on_line),
    (K.CONCENTRIC, LINE, LINE): (_parallel_direction, _on_line),
    (K.CONCENTRIC, POINT, LINE): (_on_line,),
    (K.CONCENTRIC, POINT, POINT): (_points_coincide,),
    (K.DISTANCE, PLANE, PLANE): (_parallel_direction, _height_above_plane),
    (K.DISTANCE, LINE, PLANE): (_right_angle, _height_above_plane),
    (K.DISTANCE, POINT, PLANE): (_height_above_plane,),
    (K.DISTANCE, LINE, LINE): (_parallel_direction, _off_line),
    (K.DISTANCE, POINT, LINE): (_off_line,),
    (K.DISTANCE, POINT, POINT): (_points_apart,),
    (K.ANGLE, PLANE, PLANE): (_at_angle,),
    (K.ANGLE, LINE, LINE): (_at_angle,),
    (K.ANGLE, LINE, PLANE): (_angle_to_plane,),
}
"""What holds between two features, by the kind of the relation and of the features.

Either feature may come first.
"""


def features_in_table_order(relation: Relation) -> tuple[PartFeature, PartFeature]:
    """The features of a relation in the order of the table.

    Raises `ValueError` for features that it does not join.
    """
    for earlier, later in ((relation.first, relation.second), (relation.second, relation.first)):
        if (relation.kind, earlier.kind, later.kind) in RELATION_EQUATIONS:
            return earlier, later
    first, second = relation.first.kind.value, relation.second.kind.value
    raise ValueError(f"'{relation}': {relation.kind.value} does not join a {first} and a {second}")


def relation_residual(
    relation: Relation, poses: Floats, at: tuple[int, int], size_m: float
) -> tuple[Floats, Floats]:
    """What a relation lacks (B, m), and its derivatives (B, m, 6 n), for poses (B, n, 4, 4) of n
    parts.

    Parts number `at` have the features, in the order of `in_order`. Lengths count in `size_m`.
    Derivatives are by a displacement (3) and a turn (3) of each part about its own origin, along
    the axes of the base.
    """
    first, second = features_in_table_order(relation)
    p, d, arm_p = _place_feature(first, poses[:, at[0]], size_m)
    q, e, arm_q = _place_feature(second, poses[:, at[1]], size_m)
    value = relation.value / size_m if relation.kind is RelationKind.DISTANCE else relation.value
    ends = FeatureEnds(p, d, q, e, value)
    lacks = [
        equation(ends) for equation in RELATION_EQUATIONS[relation.kind, first.kind, second.kind]
    ]
    rows = np.concatenate([lack.value for lack in lacks], axis=1)
    by = np.zeros((*rows.shape, 6 * poses.shape[1]))
    for n, by_point, by_direction, arm, direction in (
        (at[0], [lack.by_p for lack in lacks], [lack.by_d for lack in lacks], arm_p, d),
        (at[1], [lack.by_q for lack in lacks], [lack.by_e for lack in lacks], arm_q, e),
    ):
        point, line = np.concatenate(by_point, axis=1), np.concatenate(by_direction, axis=1)
        by[:, :, 6 * n : 6 * n + 3] += point
        by[:, :, 6 * n + 3 : 6 * n + 6] -= point @ skew(arm) + line @ skew(direction)
    return rows, by


def _place_feature(
    feature: PartFeature, poses: Floats, size_m: float
) -> tuple[Floats, Floats, Floats]:
    """Points and directions of a feature in the base's frame, and the way from the part's
    origin (B, 3 each).
    """
    R = poses[:, :3, :3]
    arm = R @ feature.point / size_m
    return arm + poses[:, :3, 3], R @ feature.direction, arm


MAX_NEWTON_ROUNDS = 80
STALLED_ROUNDS = 8  # rounds in which what is lacking must shrink by a tenth, or the search ends
EXACT_RESIDUAL = 1e-11  # what an equation may lack and still hold
RANK_TOLERANCE = 1e-7  # of the largest singular value: what is less is nothing


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Relations between numbered parts, of which the first is the base and stands still.

    `size_m` is the unit of lengths.
    """

    relations: tuple[Relation, ...]
    numbers: Mapping[str, int]
    size_m: float

    def only(self, relations: Sequence[Relation]) -> "System":
        """The same parts with other relations."""
        return System(tuple(relations), self.numbers, self.size_m)

    def lack(self, poses: Floats) -> tuple[Floats, Floats]:
        """What all relations lack (B, m), and its derivatives (B, m, 6 k) by the k parts that
        move.
        """
        values, derivatives = (
            [np.zeros((len(poses), 0))],
            [np.zeros((len(poses), 0, 6 * poses.shape[1]))],
        )
        for relation in self.relations:
            first, second = (
                self.numbers[feature.part] for feature in features_in_table_order(relation)
            )
            value, by = relation_residual(relation, poses, (first, second), self.size_m)
            values.append(value)
            derivatives.append(by)
        return np.concatenate(values, axis=1), np.concatenate(derivatives, axis=1)[:, :, 6:]


def displace_parts(poses: Floats, steps: Floats) -> Floats:
    """Poses (B, n, 4, 4) after displacements and turns (B, 6 k) of the parts behind the first."""
    displaced = poses.copy()
    step = steps.reshape(len(poses), -1, 6)
    displaced[:, 1:, :3, 3] += step[..., :3]
    displaced[:, 1:, :3, :3] = rotation_by_vector(step[..., 3:]) @ displaced[:, 1:, :3, :3]
    return displaced


def solve_relations(system: System, starts: Floats, one: bool = False) -> tuple[Floats, Floats]:
    """Poses (B, n, 4, 4) from starts of the same shape, and what the worst equation lacks at each
    (B,).

    With `one` it ends at the first solution.
    """
    poses, scale = starts, np.ones(len(starts))
    before: Floats = np.full(len(starts), np.inf)
    value, by = system.lack(poses)
    if not value.shape[1] or not by.shape[2]:
        return poses, np.abs(value).max(axis=1, initial=0.0)
    for round_ in range(MAX_NEWTON_ROUNDS):
        square = np.einsum("bm,bm->b", value, value)
        if np.sqrt(square.min() if one else square.max()) < EXACT_RESIDUAL:
            break
        if round_ % STALLED_ROUNDS == STALLED_ROUNDS - 1:
            if not ((square < 0.9 * before) & (square > EXACT_RESIDUAL**2)).any():
                break
            before = square
        step = _damped_step(value, by, scale * np.minimum(square, 1.0))
        tried = displace_parts(poses, step)
        new, new_by = system.lack(tried)
        better = np.einsum("bm,bm->b", new, new) < square
        scale = np.clip(np.where(better, scale / 4, scale * 4), 1e-8, 1e12)
        poses = np.where(better[:, None, None, None], tried, poses)
        value, by = (
            np.where(better[:, None], new, value),
            np.where(better[:, None, None], new_by, by),
        )
    poses = _polish_poses(system, poses)
    return poses, np.abs(system.lack(poses)[0]).max(axis=1)


def _damped_step(value: Floats, by: Floats, damping: Floats) -> Floats:
    """Steps (B, 6 k) that lessen the lack."""
    transposed = np.swapaxes(by, 1, 2)
    normal = transposed @ by + (damping + 1e-15)[:, None, None] * np.eye(by.shape[2])
    step: Floats = -np.asarray(np.linalg.solve(normal, transposed @ value[..., None]), dtype=float)[
        ..., 0
    ]
    return step


def _polish_poses(system: System, poses: Floats) -> Floats:
    """The poses after two steps of Newton that go no farther than they must, where these help."""
    for _ in range(2):
        value, by = system.lack(poses)
        step = -(np.linalg.pinv(by, rcond=RANK_TOLERANCE) @ value[..., None])[..., 0]
        near = np.abs(step).max(axis=1) < 1e-3
        tried = displace_parts(poses, np.where(near[:, None], step, 0.0))
        better = np.abs(system.lack(tried)[0]).max(axis=1) < np.abs(value).max(axis=1)
        poses = np.where(better[:, None, None, None], tried, poses)
    return poses


def free_directions(by: Floats) -> Floats:
    """An orthonormal basis (6 k, f) of the motions that derivatives (m, 6 k) do not notice."""
    if not len(by):
        return np.eye(by.shape[1])
    _, values, rows = np.linalg.svd(by)
    rank = int((values > RANK_TOLERANCE * max(1.0, values[0])).sum()) if len(values) else 0
    directions: Floats = rows[rank:].T
    return directions


def approach_preferred(
    system: System, preferred: System, poses: Floats, rounds: int = 60
) -> Floats:
    """Poses (n, 4, 4) that stay solutions and come as near to the preferred relations as the
    first ones allow.
    """
    best, least = poses, _squared_lack(preferred, poses)
    for _ in range(rounds):
        free = free_directions(system.lack(best[None])[1][0])
        value, by = (batch[0] for batch in preferred.lack(best[None]))
        if not free.shape[1] or least < EXACT_RESIDUAL**2:
            break
        step = -free @ (np.linalg.pinv(by @ free, rcond=RANK_TOLERANCE) @ value)
        nearer = _halve_step(system, preferred, best, step, least)
        if nearer is None or _squared_lack(preferred, nearer) > least * (1 - 1e-12):
            break
        best, least = nearer, _squared_lack(preferred, nearer)
    return best


def _halve_step(
    system: System, preferred: System, poses: Floats, step: Floats, least: float
) -> Floats | None:
    """The solution after a step, or after a half, a quarter and so on, that lacks less; None if
    none does.
    """
    for half in range(12):
        solutions, lacks = solve_relations(
            system, displace_parts(poses[None], (step / 2**half)[None])
        )
        if lacks[0] < EXACT_RESIDUAL * 100 and _squared_lack(preferred, solutions[0]) < least:
            best: Floats = solutions[0]
            return best
    return None


def _squared_lack(system: System, poses: Floats) -> float:
    value = system.lack(poses[None])[0][0]
    return float(value @ value)
