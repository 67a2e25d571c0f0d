"""Poses of parts from their relations: how freely they move, what is redundant or contradicts."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import rotation_by_vector, transform
from cellwright.engine.model.manipulation_values import (
    Assembled,
    AssemblyAnswer,
    Freedom,
    Relation,
    RelationContradiction,
    RelationKind,
)
from cellwright.engine.stages.assembly.relation_equations import (
    EXACT_RESIDUAL,
    System,
    approach_preferred,
    displace_parts,
    features_in_table_order,
    free_directions,
    solve_relations,
)

# steps, in sizes of the parts and rad, that are tried away from a solution
NEARBY_STEPS = (1e-2, 1e-2, 1e-2)
NEGLIGIBLE_COLUMN = 1e-6


def free_motions(system: System, poses: Floats, random: np.random.Generator) -> Floats:
    """A basis (6 k, f) of the motions of solutions around one (n, 4, 4).

    At a singular solution the derivatives promise more than there is. So solutions nearby are
    looked at, too: freedom is what all of them have. A solution without others nearby has none.
    """
    best = free_directions(system.lack(poses[None])[1][0])
    for step in NEARBY_STEPS:
        if not best.shape[1]:
            break
        weights = random.standard_normal(best.shape[1])
        away = displace_parts(
            poses[None], (best @ (weights * step / np.linalg.norm(weights)))[None]
        )
        solutions, lacks = solve_relations(system, away)
        if lacks[0] > EXACT_RESIDUAL * 100:
            continue
        if np.abs(solutions[0] - poses).max() < step * 1e-3:
            return np.zeros((best.shape[0], 0))
        free = free_directions(system.lack(solutions)[1][0])
        best = free if free.shape[1] < best.shape[1] else best
    return best


def part_freedoms(
    free: Floats, poses: Floats, parts: Sequence[str], size_m: float
) -> tuple[Freedom, ...]:
    """The ways of each part, from a basis (6 k, f) of all motions. Positions come in metres."""
    freedoms_found: list[Freedom] = []
    for n, part in enumerate(parts):
        own = _orthonormal_basis(free[6 * n : 6 * n + 6])
        freedoms_found += [
            _screw_freedom(part, twist, poses[n + 1][:3, 3], size_m) for twist in _order_twists(own)
        ]
    return tuple(freedoms_found)


def _orthonormal_basis(rows: Floats) -> Floats:
    """An orthonormal basis (6, r) of the columns of (6, f)."""
    if not rows.shape[1]:
        return rows
    u, values, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(u[:, values > NEGLIGIBLE_COLUMN])


def _order_twists(own: Floats) -> list[Floats]:
    """Slides first, then turns, each twist (6,) with its length brought to 1."""
    if not own.shape[1]:
        return []
    _, values, rows = np.linalg.svd(own[3:])
    turning = int((values > NEGLIGIBLE_COLUMN).sum())
    slides = own[:3] @ rows[turning:].T
    twists = [np.concatenate([slide, np.zeros(3)]) for slide in _near_axes_basis(slides)]
    across = np.eye(3) - slides @ slides.T
    basis = _near_axes_basis(own[3:] @ rows[:turning].T)
    for turn in basis:
        weights = np.linalg.pinv(own[3:], rcond=NEGLIGIBLE_COLUMN) @ turn
        twists.append(np.concatenate([across @ (own[:3] @ weights), turn]))
    return twists


def _near_axes_basis(vectors: Floats) -> list[Floats]:
    """Unit vectors that span the same as the columns (3, r), as near to the axes as they can be."""
    basis: list[Floats] = []
    projection = vectors @ np.linalg.pinv(vectors) if vectors.shape[1] else np.zeros((3, 3))
    for _ in range(vectors.shape[1]):
        axis = int(np.argmax(np.round(np.diagonal(projection), 9)))
        unit = projection[:, axis] / np.linalg.norm(projection[:, axis])
        basis.append(unit)
        projection = projection - np.outer(unit, unit)
    return basis


def _screw_freedom(part: str, twist: Floats, origin: Floats, size_m: float) -> Freedom:
    """The screw of a twist (6,) about a part's origin, which is given in sizes."""
    shift, turn = twist[:3], twist[3:]
    length = float(np.linalg.norm(turn))
    if length < NEGLIGIBLE_COLUMN:
        return Freedom(part, shift / np.linalg.norm(shift), origin * size_m, float("inf"))
    axis = turn / length
    pitch = float(axis @ shift) / length
    point = origin + np.cross(axis, shift) / length
    return Freedom(
        part, axis, point * size_m, 0.0 if abs(pitch) < NEGLIGIBLE_COLUMN else pitch * size_m
    )


SOLUTION_STARTS = 32
MAX_PREFERENCE_STARTS = 4  # solutions from which preferred relations are approached
HOLDS_TOLERANCE = EXACT_RESIDUAL * 100
# by which solutions differ, in sizes of the parts and in entries of rotations
DISTINCT_SOLUTIONS = 1e-6


def assemble_parts(
    relations: Sequence[Relation],
    base: str,
    starts: Mapping[str, Floats] | None = None,
    seed: int = 0,
) -> AssemblyAnswer:
    """Poses of all parts in the frame of `base` with which the relations hold; else the least that
    contradicts itself.

    What stays free is near to `starts`, poses T_base_part (4, 4) by part, where given. Raises
    `ValueError` for a relation that does not join its features, or whose features are on one part.
    """
    _refuse_bad_relations(relations)
    hard = tuple(relation for relation in relations if not relation.preferred)
    system = _relation_system(relations, hard, base, starts or {})
    random = np.random.default_rng(seed)
    begin = _start_poses(system, starts or {}, random)
    solutions, lacks = solve_relations(system, begin)
    if lacks.min() > HOLDS_TOLERANCE:
        return _find_contradiction(system, begin)
    fits = _distinct_solutions(solutions[lacks <= HOLDS_TOLERANCE])
    soft = system.only([relation for relation in relations if relation.preferred])
    chosen = (
        [approach_preferred(system, soft, solution) for solution in fits[:MAX_PREFERENCE_STARTS]]
        if soft.relations
        else fits
    )
    best = min(range(len(chosen)), key=lambda n: (round(_preference_lack(soft, chosen[n]), 9), n))
    return _assembly_answer(system, chosen, best, random)


def _refuse_bad_relations(relations: Sequence[Relation]) -> None:
    for relation in relations:
        features_in_table_order(relation)
        if relation.first.part == relation.second.part:
            raise ValueError(f"'{relation}': both features are on {relation.first.part}")
        if not np.isfinite(relation.value):
            raise ValueError(f"'{relation}': the value must be a finite number")


def _relation_system(
    relations: Sequence[Relation],
    hard: tuple[Relation, ...],
    base: str,
    starts: Mapping[str, Floats],
) -> System:
    named = [part for relation in relations for part in (relation.first.part, relation.second.part)]
    parts = dict.fromkeys([base, *named, *starts])
    lengths = [
        np.abs(end.point).max()
        for relation in relations
        for end in (relation.first, relation.second)
    ]
    lengths += [
        abs(relation.value) for relation in relations if relation.kind is RelationKind.DISTANCE
    ]
    size = float(max(lengths, default=0.0))
    return System(hard, {part: n for n, part in enumerate(parts)}, size if size > 0 else 1.0)


def _start_poses(
    system: System, starts: Mapping[str, Floats], random: np.random.Generator
) -> Floats:
    """Poses (B, n, 4, 4) in sizes of the parts: first the given ones, then drawn ones that
    cover the turns.
    """
    count = len(system.numbers)
    poses = np.broadcast_to(np.eye(4), (SOLUTION_STARTS, count, 4, 4)).copy()
    turns = random.standard_normal((SOLUTION_STARTS - 1, count - 1, 4))
    poses[1:, 1:] = transform(
        _of_quaternions(turns), random.uniform(-2, 2, (SOLUTION_STARTS - 1, count - 1, 3))
    )
    for part, T in starts.items():
        n = system.numbers[part]
        poses[0, n] = T
        poses[0, n, :3, 3] /= system.size_m
    if not starts and count > 1:
        poses[0, 1:, :3, :3] = rotation_by_vector(np.full((count - 1, 3), 0.1))
    return poses


def _of_quaternions(values: Floats) -> Floats:
    """Rotations (..., 3, 3) of quaternions (..., 4) of any length: evenly spread if these are
    drawn from a normal law.
    """
    unit = values / np.linalg.norm(values, axis=-1, keepdims=True)
    half = np.arccos(np.clip(unit[..., :1], -1, 1))
    sine = np.sqrt(np.maximum(1 - unit[..., :1] ** 2, 1e-30))
    return rotation_by_vector(2 * half * unit[..., 1:] / sine)


def _distinct_solutions(poses: Floats) -> list[Floats]:
    """The solutions (n, 4, 4), each once, in order."""
    distinct: list[Floats] = []
    for pose in poses:
        if all(np.abs(pose - earlier).max() > DISTINCT_SOLUTIONS for earlier in distinct):
            distinct.append(pose)
    return distinct


def _preference_lack(soft: System, poses: Floats) -> float:
    return float(np.abs(soft.lack(poses[None])[0]).max(initial=0.0))


def _assembly_answer(
    system: System, chosen: Sequence[Floats], best: int, random: np.random.Generator
) -> Assembled:
    poses = chosen[best]
    free = free_motions(system, poses, random)
    alternatives = (
        [solution for n, solution in enumerate(chosen) if n != best] if not free.shape[1] else []
    )
    return Assembled(
        _poses_by_part(system, poses),
        free.shape[1],
        part_freedoms(free, poses, list(system.numbers)[1:], system.size_m),
        _redundant_relations(system, poses, random),
        tuple(_poses_by_part(system, alternative) for alternative in alternatives),
        float(np.abs(system.lack(poses[None])[0]).max(initial=0.0)),
    )


def _poses_by_part(system: System, poses: Floats) -> dict[str, Floats]:
    poses_by_part = {}
    for part, n in system.numbers.items():
        poses_by_part[part] = poses[n].copy()
        poses_by_part[part][:3, 3] *= system.size_m
    return poses_by_part


def _redundant_relations(
    system: System, poses: Floats, random: np.random.Generator
) -> tuple[Relation, ...]:
    """Relations that follow from those kept, from the last to the first: all can be left out
    together.
    """
    needed = list(system.relations)
    for relation in reversed(system.relations):
        remaining = system.only(
            [needed_relation for needed_relation in needed if needed_relation is not relation]
        )
        if _follows_from(remaining, system.only([relation]), poses, random):
            needed.remove(relation)
    return tuple(relation for relation in system.relations if relation not in needed)


def _follows_from(
    remaining: System, tested: System, poses: Floats, random: np.random.Generator
) -> bool:
    """Whether every solution of the others has this relation, too: by freedom at a solution,
    then by many solutions.
    """
    both = np.concatenate([remaining.lack(poses[None])[1][0], tested.lack(poses[None])[1][0]])
    alone = free_directions(remaining.lack(poses[None])[1][0])
    if free_directions(both).shape[1] < alone.shape[1]:
        return False
    solutions, lacks = solve_relations(remaining, _start_poses(remaining, {}, random))
    tried = solutions[lacks <= HOLDS_TOLERANCE]
    return bool(np.abs(tested.lack(tried)[0]).max(initial=0.0) < HOLDS_TOLERANCE * 10)


def _find_contradiction(system: System, begin: Floats) -> RelationContradiction:
    """A contradictory set of the least size: a least set that hits what every agreeing set
    leaves out (Ignatiev 2015).
    """
    count = len(system.relations)
    left_out: list[frozenset[int]] = []
    for chosen in _hitting_sets(count, left_out):
        part = system.only([system.relations[n] for n in chosen])
        solutions, lacks = solve_relations(part, begin, one=True)
        if lacks.min() > HOLDS_TOLERANCE:
            return RelationContradiction(part.relations)
        left_out.append(
            _grow_agreeing_set(system, begin, chosen, solutions[lacks <= HOLDS_TOLERANCE])
        )
    return RelationContradiction(system.relations)


def _hitting_sets(count: int, left_out: list[frozenset[int]]) -> Iterator[tuple[int, ...]]:
    """Sets in order of size that hit all those left out so far; the list grows meanwhile."""
    for size in range(1, count + 1):
        for chosen in combinations(range(count), size):
            if all(not omitted.isdisjoint(chosen) for omitted in left_out):
                yield chosen


def _grow_agreeing_set(
    system: System, begin: Floats, chosen: tuple[int, ...], solutions: Floats
) -> frozenset[int]:
    """What a largest agreeing set around `chosen` leaves out."""
    agreeing, open_ = list(chosen), [n for n in range(len(system.relations)) if n not in chosen]
    for n in open_:
        lacks = np.abs(system.only([system.relations[n]]).lack(solutions)[0]).max(axis=1)
        if lacks.min() > HOLDS_TOLERANCE:
            part = system.only([system.relations[k] for k in (*agreeing, n)])
            grown, lacks = solve_relations(part, np.concatenate([solutions[:8], begin]), one=True)
            if lacks.min() > HOLDS_TOLERANCE:
                continue
            solutions = grown
        agreeing.append(n)
        solutions = solutions[lacks <= HOLDS_TOLERANCE]
    return frozenset(range(len(system.relations))) - frozenset(agreeing)
