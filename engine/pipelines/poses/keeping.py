"""Poses of measurements in a store, and out of it again."""

import json
from collections.abc import Collection
from typing import Any

import numpy as np

from cellwright.engine.model.poses import Box, MeasurementPoses
from cellwright.engine.pipelines.poses import Key, Knowledge, known_poses
from cellwright.engine.ports import GeometryBackend
from cellwright.kb.json_text import parsed
from cellwright.kb.model.cell import Cell, Patch
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.poses import PoseStore


def kept_poses(
    store: str,
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    only: Collection[str] | None = None,
) -> Knowledge:
    """The poses of a problem's measurements, or of some: those of the store that are still valid, the others found and kept there.

    Raises `InvalidInput` if the store cannot be used. A document that cannot be read counts as missing.
    """
    with PoseStore(store) as poses:
        documents = poses.of(problem.domain.name, problem.name)
        documents = {key: text for key, text in documents.items() if only is None or key[0] in only}
        known = {key: found for key, text in documents.items() if (found := _read(text)) is not None}
        knowledge = known_poses(problem, cell, backend, known, only)
        if knowledge.made or knowledge.poses.keys() != documents.keys():
            fresh: dict[Key, str] = {key: _written(each) for key, each in knowledge.poses.items()}
            poses.keep(problem.domain.name, problem.name, fresh, only)
    return knowledge


def _written(poses: MeasurementPoses) -> str:
    patch = poses.patch
    entry = {
        "measurement": poses.measurement,
        "tool": poses.tool,
        "station": poses.station,
        "straight": [each.tolist() for each in poses.straight],
        "tilt_rad": poses.tilt_rad,
        "patch": None if patch is None else [patch.at_m, patch.size_m],
        "reason": poses.reason,
        "boxes": poses.boxes,
        "own": poses.own,
        "near": poses.near,
        "sigma_m": poses.sigma_m,
    }
    return json.dumps(entry)


def _read(text: str) -> MeasurementPoses | None:
    try:
        entry = parsed(text)
        return MeasurementPoses(
            str(entry["measurement"]),
            str(entry["tool"]),
            str(entry["station"]),
            tuple(np.array(each, dtype=float) for each in entry["straight"]),
            float(entry["tilt_rad"]),
            _patch(entry["patch"]),
            str(entry["reason"]),
            tuple(map(_box, entry["boxes"])),
            str(entry["own"]),
            str(entry["near"]),
            float(entry["sigma_m"]),
        )
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def _patch(said: Any) -> Patch | None:
    return None if said is None else Patch((said[0][0], said[0][1]), (said[1][0], said[1][1]))


def _box(said: Any) -> Box:
    (a, b, c), (d, e, f) = said
    return ((float(a), float(b), float(c)), (float(d), float(e), float(f)))
