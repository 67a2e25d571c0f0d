"""Answers what parts' poses follow from relations, how freely, which relations say nothing new, and which contradict."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from cellwright.engine.kernels.rigid import transform, turned
from cellwright.engine.model.assembly import Assembled, AssemblyAnswer, Contradiction, Relation, RelationKind
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.assembly.equations import in_order
from cellwright.engine.stages.assembly.freedom import free_motions, freedoms
from cellwright.engine.stages.assembly.solving import EXACT, System, free_directions, solved, towards

STARTS = 32
WISHED = 4  # solutions from which preferred relations are approached
HOLDS = EXACT * 100
DIFFERENT = 1e-6  # by which solutions differ, in sizes of the parts and in entries of rotations


def assemble(
    relations: Sequence[Relation], base: str, starts: Mapping[str, Floats] | None = None, seed: int = 0
) -> AssemblyAnswer:
    """Poses of all parts in the frame of `base` with which the relations hold; else the least that contradicts itself.

    What stays free is near to `starts`, poses T_base_part (4, 4) by part, where given. Raises `ValueError` for a relation
    that does not join its features, or whose features are on one part.
    """
    _refuse(relations)
    hard = tuple(each for each in relations if not each.preferred)
    system = _system(relations, hard, base, starts or {})
    random = np.random.default_rng(seed)
    begin = _starts(system, starts or {}, random)
    found, lacks = solved(system, begin)
    if lacks.min() > HOLDS:
        return _contradiction(system, begin)
    fits = _distinct(found[lacks <= HOLDS])
    soft = system.only([each for each in relations if each.preferred])
    chosen = [towards(system, soft, each) for each in fits[:WISHED]] if soft.relations else fits
    best = min(range(len(chosen)), key=lambda n: (round(_lacking(soft, chosen[n]), 9), n))
    return _assembled(system, chosen, best, random)


def _refuse(relations: Sequence[Relation]) -> None:
    for each in relations:
        in_order(each)
        if each.first.part == each.second.part:
            raise ValueError(f"'{each}': both features are on {each.first.part}")
        if not np.isfinite(each.value):
            raise ValueError(f"'{each}': the value must be a finite number")


def _system(
    relations: Sequence[Relation], hard: tuple[Relation, ...], base: str, starts: Mapping[str, Floats]
) -> System:
    named = [part for each in relations for part in (each.first.part, each.second.part)]
    parts = dict.fromkeys([base, *named, *starts])
    lengths = [np.abs(end.point).max() for each in relations for end in (each.first, each.second)]
    lengths += [abs(each.value) for each in relations if each.kind is RelationKind.DISTANCE]
    size = float(max(lengths, default=0.0))
    return System(hard, {part: n for n, part in enumerate(parts)}, size if size > 0 else 1.0)


def _starts(system: System, starts: Mapping[str, Floats], random: np.random.Generator) -> Floats:
    """Poses (B, n, 4, 4) in sizes of the parts: first the given ones, then drawn ones that cover the turns."""
    count = len(system.numbers)
    poses = np.broadcast_to(np.eye(4), (STARTS, count, 4, 4)).copy()
    turns = random.standard_normal((STARTS - 1, count - 1, 4))
    poses[1:, 1:] = transform(_of_quaternions(turns), random.uniform(-2, 2, (STARTS - 1, count - 1, 3)))
    for part, T in starts.items():
        n = system.numbers[part]
        poses[0, n] = T
        poses[0, n, :3, 3] /= system.size_m
    if not starts and count > 1:
        poses[0, 1:, :3, :3] = turned(np.full((count - 1, 3), 0.1))
    return poses


def _of_quaternions(values: Floats) -> Floats:
    """Rotations (..., 3, 3) of quaternions (..., 4) of any length: evenly spread if these are drawn from a normal law."""
    unit = values / np.linalg.norm(values, axis=-1, keepdims=True)
    half = np.arccos(np.clip(unit[..., :1], -1, 1))
    sine = np.sqrt(np.maximum(1 - unit[..., :1] ** 2, 1e-30))
    return turned(2 * half * unit[..., 1:] / sine)


def _distinct(poses: Floats) -> list[Floats]:
    """The solutions (n, 4, 4), each once, in order."""
    kept: list[Floats] = []
    for each in poses:
        if all(np.abs(each - other).max() > DIFFERENT for other in kept):
            kept.append(each)
    return kept


def _lacking(soft: System, poses: Floats) -> float:
    return float(np.abs(soft.lack(poses[None])[0]).max(initial=0.0))


def _assembled(system: System, chosen: Sequence[Floats], best: int, random: np.random.Generator) -> Assembled:
    poses = chosen[best]
    free = free_motions(system, poses, random)
    others = [each for n, each in enumerate(chosen) if n != best] if not free.shape[1] else []
    return Assembled(
        _named(system, poses),
        free.shape[1],
        freedoms(free, poses, list(system.numbers)[1:], system.size_m),
        _redundant(system, poses, random),
        tuple(_named(system, each) for each in others),
        float(np.abs(system.lack(poses[None])[0]).max(initial=0.0)),
    )


def _named(system: System, poses: Floats) -> dict[str, Floats]:
    found = {}
    for part, n in system.numbers.items():
        found[part] = poses[n].copy()
        found[part][:3, 3] *= system.size_m
    return found


def _redundant(system: System, poses: Floats, random: np.random.Generator) -> tuple[Relation, ...]:
    """Relations that follow from those kept, from the last to the first: all can be left out together."""
    kept = list(system.relations)
    for relation in reversed(system.relations):
        others = system.only([each for each in kept if each is not relation])
        if _follows(others, system.only([relation]), poses, random):
            kept.remove(relation)
    return tuple(each for each in system.relations if each not in kept)


def _follows(others: System, one: System, poses: Floats, random: np.random.Generator) -> bool:
    """Whether every solution of the others has this relation, too: by freedom at a solution, then by many solutions."""
    both = np.concatenate([others.lack(poses[None])[1][0], one.lack(poses[None])[1][0]])
    alone = free_directions(others.lack(poses[None])[1][0])
    if free_directions(both).shape[1] < alone.shape[1]:
        return False
    found, lacks = solved(others, _starts(others, {}, random))
    tried = found[lacks <= HOLDS]
    return bool(np.abs(one.lack(tried)[0]).max(initial=0.0) < HOLDS * 10)


def _contradiction(system: System, begin: Floats) -> Contradiction:
    """A contradictory set of the least size: a least set that hits what every agreeing set leaves out (Ignatiev 2015)."""
    count = len(system.relations)
    left_out: list[frozenset[int]] = []
    for chosen in _candidates(count, left_out):
        part = system.only([system.relations[n] for n in chosen])
        found, lacks = solved(part, begin, one=True)
        if lacks.min() > HOLDS:
            return Contradiction(part.relations)
        left_out.append(_grown(system, begin, chosen, found[lacks <= HOLDS]))
    return Contradiction(system.relations)


def _candidates(count: int, left_out: list[frozenset[int]]) -> Iterator[tuple[int, ...]]:
    """Sets in order of size that hit all those left out so far; the list grows meanwhile."""
    for size in range(1, count + 1):
        for chosen in combinations(range(count), size):
            if all(not each.isdisjoint(chosen) for each in left_out):
                yield chosen


def _grown(system: System, begin: Floats, chosen: tuple[int, ...], solutions: Floats) -> frozenset[int]:
    """What a largest agreeing set around `chosen` leaves out."""
    kept, open_ = list(chosen), [n for n in range(len(system.relations)) if n not in chosen]
    for n in open_:
        lacks = np.abs(system.only([system.relations[n]]).lack(solutions)[0]).max(axis=1)
        if lacks.min() > HOLDS:
            part = system.only([system.relations[k] for k in (*kept, n)])
            found, lacks = solved(part, np.concatenate([solutions[:8], begin]), one=True)
            if lacks.min() > HOLDS:
                continue
            solutions = found
        kept.append(n)
        solutions = solutions[lacks <= HOLDS]
    return frozenset(range(len(system.relations))) - frozenset(kept)
