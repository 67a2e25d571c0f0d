"""TSPLIB files (Reinelt 1991): symmetric and asymmetric instances, and the tours that go with them.

All distances are whole numbers, computed as the library prescribes.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.model.tour import Longs, TourProblem, Visit
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.files import File, read_file

MAX_CITIES = 8_000
SECTION = re.compile(r"^\s*([A-Z_]+_SECTION)\s*:?\s*$", re.MULTILINE)
Floats = NDArray[np.float64]


def read_tsplib(path: Path) -> TourProblem:
    """The instance in a file, as a closed tour. Raises `InvalidInput`."""
    file = read_file(path)
    head, sections = _parts(file)
    n = _count(file, head)
    travel, positions = _distances(file, head, sections, n)
    places = positions if positions is not None else _numbers(file, sections, "DISPLAY_DATA_SECTION", 3 * n)
    where = None if places is None else places.reshape(n, 3)
    names = [str(i + 1) for i in range(n)] if where is None else [str(int(row[0])) for row in where]
    visits = tuple(
        Visit(names[i], None if where is None else (float(where[i, 1]), float(where[i, 2]))) for i in range(n)
    )
    return TourProblem(head.get("NAME", path.stem), visits, travel)


def _wrong(where: Source, message: str, hint: str = "") -> InvalidInput:
    return InvalidInput([Diagnostic(where, "K803", message, hint)])


def _parts(file: File) -> tuple[dict[str, str], dict[str, tuple[int, str]]]:
    """The entries of the head, and the place and text of each section."""
    text = file.text.split("\nEOF")[0]
    marks = [*SECTION.finditer(text)]
    head_text = text[: marks[0].start()] if marks else text
    head = {}
    for line in head_text.splitlines():
        key, colon, value = line.partition(":")
        if colon:
            head[key.strip()] = value.strip()
    ends = [*(mark.start() for mark in marks), len(text)][1:]
    sections = {mark[1]: (mark.end(), text[mark.end() : end]) for mark, end in zip(marks, ends, strict=True)}
    return head, sections


def _count(file: File, head: dict[str, str]) -> int:
    kind, size = head.get("TYPE", "").split()[:1], head.get("DIMENSION", "")
    if kind not in (["TSP"], ["ATSP"]):
        raise _wrong(Source(file.path), "TYPE is neither TSP nor ATSP", "name a TSPLIB instance")
    if not size.isdecimal() or not 1 <= int(size) <= MAX_CITIES:
        raise _wrong(Source(file.path), f"DIMENSION is not a number from 1 to {MAX_CITIES}")
    return int(size)


def _numbers(file: File, sections: dict[str, tuple[int, str]], name: str, count: int) -> Floats | None:
    """The numbers of a section; None if there is no such section."""
    if name not in sections:
        return None
    start, text = sections[name]
    try:
        found = np.array(text.split(), dtype=float)
    except ValueError:
        bad = next(each for each in re.finditer(r"\S+", text) if not _is_number(each[0]))
        raise _wrong(file.at(start + bad.start()), f"'{bad[0]}' is not a number") from None
    if len(found) != count or not np.isfinite(found).all():
        raise _wrong(file.at(start), f"{name} has {len(found)} numbers, but {count} are needed")
    return found


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _distances(
    file: File, head: dict[str, str], sections: dict[str, tuple[int, str]], n: int
) -> tuple[Longs, Floats | None]:
    """The costs, and the coordinates if the costs were computed from coordinates."""
    kind = head.get("EDGE_WEIGHT_TYPE", "EXPLICIT" if "ATSP" in head.get("TYPE", "") else "")
    if kind == "EXPLICIT":
        return _explicit(file, head, sections, n), None
    if kind not in METRICS:
        known = ", ".join(("EXPLICIT", *METRICS))
        raise _wrong(Source(file.path), f"EDGE_WEIGHT_TYPE '{kind}' is not supported", f"one of {known}")
    rows = _numbers(file, sections, "NODE_COORD_SECTION", 3 * n)
    if rows is None:
        raise _wrong(Source(file.path), "there is no NODE_COORD_SECTION")
    positions = rows.reshape(n, 3)[:, 1:]
    travel = np.empty((n, n), np.int64)
    for i in range(n):
        travel[i] = METRICS[kind](positions[i : i + 1], positions)[0]
    np.fill_diagonal(travel, 0)
    return travel, rows


def _euclidean(a: Floats, b: Floats) -> Floats:
    found: Floats = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    return found


def _rounded(a: Floats, b: Floats) -> Floats:
    return np.floor(_euclidean(a, b) + 0.5)


def _raised(a: Floats, b: Floats) -> Floats:
    return np.ceil(_euclidean(a, b))


def _manhattan(a: Floats, b: Floats) -> Floats:
    found: Floats = np.floor(np.abs(a[:, None] - b[None]).sum(axis=2) + 0.5)
    return found


def _largest(a: Floats, b: Floats) -> Floats:
    found: Floats = np.floor(np.abs(a[:, None] - b[None]) + 0.5).max(axis=2)
    return found


def _pseudo_euclidean(a: Floats, b: Floats) -> Floats:
    exact = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2) / 10.0)
    near = np.floor(exact + 0.5)
    found: Floats = near + (near < exact)
    return found


def _geographical(a: Floats, b: Floats) -> Floats:
    """Distances on the sphere in kilometres; coordinates are DDD.MM, and pi is 3.141592."""

    def radians(x: Floats) -> Floats:
        degrees = np.trunc(x)
        found: Floats = 3.141592 * (degrees + 5.0 * (x - degrees) / 3.0) / 180.0
        return found

    u, v = radians(a), radians(b)
    q1 = np.cos(u[:, None, 1] - v[None, :, 1])
    q2 = np.cos(u[:, None, 0] - v[None, :, 0])
    q3 = np.cos(u[:, None, 0] + v[None, :, 0])
    cosine = np.clip(0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3), -1.0, 1.0)
    return np.trunc(6378.388 * np.arccos(cosine) + 1.0)


METRICS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "EUC_2D": _rounded,
    "CEIL_2D": _raised,
    "MAN_2D": _manhattan,
    "MAX_2D": _largest,
    "ATT": _pseudo_euclidean,
    "GEO": _geographical,
}


def _explicit(file: File, head: dict[str, str], sections: dict[str, tuple[int, str]], n: int) -> Longs:
    """The matrix of costs that the file gives explicitly."""
    shape = head.get("EDGE_WEIGHT_FORMAT", "FULL_MATRIX")
    if shape not in SHAPES:
        raise _wrong(
            Source(file.path), f"EDGE_WEIGHT_FORMAT '{shape}' is not supported", f"one of {', '.join(SHAPES)}"
        )
    cells = [*SHAPES[shape](n)]
    numbers = _numbers(file, sections, "EDGE_WEIGHT_SECTION", len(cells))
    if numbers is None:
        raise _wrong(Source(file.path), "there is no EDGE_WEIGHT_SECTION")
    travel = np.zeros((n, n), np.int64)
    rows, columns = np.array(cells).T if cells else (np.zeros(0, int), np.zeros(0, int))
    travel[rows, columns] = np.rint(numbers)
    if shape != "FULL_MATRIX":
        travel[columns, rows] = np.rint(numbers)
    np.fill_diagonal(travel, 0)
    if travel.min(initial=0) < 0 or travel.max(initial=0) > 2**40:
        raise _wrong(Source(file.path), "a cost is negative or too large")
    return travel


Cells = Iterator[tuple[int, int]]
SHAPES: dict[str, Callable[[int], Cells]] = {
    "FULL_MATRIX": lambda n: ((i, j) for i in range(n) for j in range(n)),
    "UPPER_ROW": lambda n: ((i, j) for i in range(n) for j in range(i + 1, n)),
    "LOWER_ROW": lambda n: ((i, j) for i in range(n) for j in range(i)),
    "UPPER_DIAG_ROW": lambda n: ((i, j) for i in range(n) for j in range(i, n)),
    "LOWER_DIAG_ROW": lambda n: ((i, j) for i in range(n) for j in range(i + 1)),
    "UPPER_COL": lambda n: ((i, j) for j in range(n) for i in range(j)),
    "LOWER_COL": lambda n: ((i, j) for j in range(n) for i in range(j + 1, n)),
}
