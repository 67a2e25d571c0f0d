"""Visits to be put in a tour: from a TSPLIB file, or the measurements of a problem.

All distances are whole numbers, computed as the library prescribes.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.part_measurements import is_shared
from cellwright.engine.model.tour_problem import Metric, TourProblem, Visit
from cellwright.engine.pipelines.inspection.measurement_points import with_places
from cellwright.engine.pipelines.inspection.tool_tours import (
    TourVisits,
    partition_by_tool,
    tour_problem,
)
from cellwright.engine.pipelines.inspection.tour_demands import (
    of_options,
    require_known_visits,
    with_demands,
)
from cellwright.engine.pipelines.planning.target_files import problem_of
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, is_file, read_file
from cellwright.kb.numbers import MAX_NUMBER_CHARACTERS, NumberError, read_decimal, read_whole

MAX_CITIES = 1_000_000
MAX_COST = 1e9  # of a coordinate or a cost: the cost of a tour of a million cities stays exact
MAX_MATRIX_CITIES = 8_000  # at most so many cities with a matrix of costs
MAX_EXPLICIT_CITIES = 1_000  # costs of more cities are computed when they are needed
SECTION_LINE = re.compile(r"^\s*([A-Z_]+_SECTION)\s*:?\s*$", re.MULTILINE)
Floats = NDArray[np.float64]


def read_tsplib(path: Path) -> TourProblem:
    """The instance in a file, as a closed tour. Raises `InvalidInput`."""
    file = read_file(path)
    head, sections = _split_file(file)
    n = _city_count(file, head)
    travel, positions = _costs_of_file(file, head, sections, n)
    places = (
        positions
        if positions is not None
        else _section_numbers(file, sections, "DISPLAY_DATA_SECTION", 3 * n)
    )
    where = None if places is None else places.reshape(n, 3)
    names = (
        [str(i + 1) for i in range(n)]
        if where is None
        else _city_names(file, sections, where[:, 0])
    )
    visits = tuple(
        Visit(names[i], None if where is None else (float(where[i, 1]), float(where[i, 2])))
        for i in range(n)
    )
    return TourProblem(head.get("NAME", path.stem), visits, travel)


def vanishing(problem: TourProblem, path: Path) -> tuple[Diagnostic, ...]:
    """A warning if rounding to whole numbers leaves no cost between different places of the file.

    Raises `InvalidInput`.
    """
    head, _ = _split_file(read_file(path))
    if (
        head.get("EDGE_WEIGHT_TYPE") not in METRIC_FUNCTIONS
        or len(problem.visits) > MAX_MATRIX_CITIES
    ):
        return ()
    points = np.array([visit.position or (0.0, 0.0) for visit in problem.visits])
    arcs, every, pairs = problem.travel, np.arange(len(points), dtype=np.int32), 0
    for city in range(len(points)):
        costs = (
            arcs.between(every[city : city + 1], every) if isinstance(arcs, Metric) else arcs[city]
        )
        pairs += int(((points != points[city]).any(axis=1) & (costs == 0)).sum())
    if not pairs:
        return ()
    said = (
        f"rounding to whole numbers leaves no distance between {count_noun(pairs // 2, 'pair')} "
        "of different cities"
    )
    hint = "write the coordinates in a smaller unit, such as millimetres for metres"
    return (Diagnostic(Source(str(path)), "K808", said, hint, warning=True),)


def _city_names(file: File, sections: dict[str, tuple[int, str]], numbers: Floats) -> list[str]:
    """The names of the cities: their numbers, which are whole and all different."""
    name = "NODE_COORD_SECTION" if "NODE_COORD_SECTION" in sections else "DISPLAY_DATA_SECTION"
    start, text = sections[name]
    tokens = [token.start() for token in re.finditer(r"\S+", text)][::3]
    seen: set[float] = set()
    for place, number in zip(tokens, numbers.tolist(), strict=True):
        if number in seen or not number.is_integer():
            why = "is used twice" if number in seen else "is not whole"
            raise _bad_tsplib(
                file.at(start + place),
                f"the number {number:g} of a city {why}",
                "number them 1, 2, 3",
            )
        seen.add(number)
    return [str(int(city)) for city in numbers]


def _bad_tsplib(where: Source, message: str, hint: str = "") -> InvalidInput:
    return InvalidInput([Diagnostic(where, "K803", message, hint)])


def _split_file(file: File) -> tuple[dict[str, str], dict[str, tuple[int, str]]]:
    """The entries of the head, and the place and text of each section."""
    text = file.text.split("\nEOF")[0]
    marks = [*SECTION_LINE.finditer(text)]
    head_text = text[: marks[0].start()] if marks else text
    head = {}
    for line in head_text.splitlines():
        key, colon, value = line.partition(":")
        if colon:
            head[key.strip()] = value.strip()
    ends = [*(mark.start() for mark in marks), len(text)][1:]
    sections = {
        mark[1]: (mark.end(), text[mark.end() : end]) for mark, end in zip(marks, ends, strict=True)
    }
    return head, sections


def _city_count(file: File, head: dict[str, str]) -> int:
    kind, size = head.get("TYPE", "").split()[:1], head.get("DIMENSION", "")
    if kind not in (["TSP"], ["ATSP"]):
        raise _bad_tsplib(
            Source(file.path), "TYPE is neither TSP nor ATSP", "name a TSPLIB instance"
        )
    try:
        return read_whole(size, 1, MAX_CITIES)
    except NumberError:
        raise _bad_tsplib(
            Source(file.path), f"DIMENSION is not a number from 1 to {MAX_CITIES}"
        ) from None


def _section_numbers(
    file: File, sections: dict[str, tuple[int, str]], name: str, count: int
) -> Floats | None:
    """The numbers of a section; None if there is no such section."""
    if name not in sections:
        return None
    start, text = sections[name]
    try:
        values = np.array(text.split(), dtype=float)
    except ValueError:
        values = np.array([np.nan])
    if not (np.abs(values) <= MAX_COST).all():
        raise _bad_number(file, start, text)
    if len(values) != count:
        raise _bad_tsplib(
            file.at(start), f"{name} has {len(values)} numbers, but {count} are needed"
        )
    return values


def _bad_number(file: File, start: int, text: str) -> InvalidInput:
    """What is wrong with the first bad number of a section."""
    for token in re.finditer(r"\S+", text):
        try:
            read_decimal(token[0], MAX_COST)
        except NumberError as error:
            return _bad_tsplib(
                file.at(start + token.start()), f"'{token[0][:MAX_NUMBER_CHARACTERS]}' {error}"
            )
    return _bad_tsplib(file.at(start), "a number that cannot be read")


def _costs_of_file(
    file: File, head: dict[str, str], sections: dict[str, tuple[int, str]], n: int
) -> tuple[Longs | Metric, Floats | None]:
    """The costs, and the coordinates if the costs were computed from coordinates."""
    kind = head.get("EDGE_WEIGHT_TYPE", "EXPLICIT" if "ATSP" in head.get("TYPE", "") else "")
    if kind == "EXPLICIT":
        return _explicit_matrix(file, head, sections, n), None
    if kind not in METRIC_FUNCTIONS:
        known = ", ".join(("EXPLICIT", *METRIC_FUNCTIONS))
        raise _bad_tsplib(
            Source(file.path), f"EDGE_WEIGHT_TYPE '{kind}' is not supported", f"one of {known}"
        )
    rows = _section_numbers(file, sections, "NODE_COORD_SECTION", 3 * n)
    if rows is None:
        raise _bad_tsplib(Source(file.path), "there is no NODE_COORD_SECTION")
    metric = Metric(METRIC_FUNCTIONS[kind], np.ascontiguousarray(rows.reshape(n, 3)[:, 1:]))
    if kind == "GEO":
        _not_too_many(file, n, "EDGE_WEIGHT_TYPE GEO")
    return metric if n > MAX_EXPLICIT_CITIES and kind != "GEO" else metric.matrix(), rows


def _not_too_many(file: File, n: int, what: str) -> None:
    """Raises `InvalidInput` if a matrix of costs would be too large."""
    if n > MAX_MATRIX_CITIES:
        hint = "coordinates with EUC_2D, CEIL_2D, MAN_2D, MAX_2D or ATT may have more"
        raise _bad_tsplib(
            Source(file.path), f"{what} allows at most {MAX_MATRIX_CITIES} cities", hint
        )


METRIC_FUNCTIONS = {
    "EUC_2D": "rounded",
    "CEIL_2D": "raised",
    "MAN_2D": "manhattan",
    "MAX_2D": "largest",
    "ATT": "pseudo_euclidean",
    "GEO": "geographical",
}


def _explicit_matrix(
    file: File, head: dict[str, str], sections: dict[str, tuple[int, str]], n: int
) -> Longs:
    """The matrix of costs that the file gives explicitly."""
    shape = head.get("EDGE_WEIGHT_FORMAT", "FULL_MATRIX")
    if shape not in MATRIX_SHAPES:
        raise _bad_tsplib(
            Source(file.path),
            f"EDGE_WEIGHT_FORMAT '{shape}' is not supported",
            f"one of {', '.join(MATRIX_SHAPES)}",
        )
    _not_too_many(file, n, "EXPLICIT")
    cells = [*MATRIX_SHAPES[shape](n)]
    numbers = _section_numbers(file, sections, "EDGE_WEIGHT_SECTION", len(cells))
    if numbers is None:
        raise _bad_tsplib(Source(file.path), "there is no EDGE_WEIGHT_SECTION")
    travel = np.zeros((n, n), np.int64)
    rows, columns = np.array(cells).T if cells else (np.zeros(0, int), np.zeros(0, int))
    travel[rows, columns] = np.rint(numbers)
    if shape != "FULL_MATRIX":
        travel[columns, rows] = np.rint(numbers)
    np.fill_diagonal(travel, 0)
    if travel.min(initial=0) < 0:
        raise _bad_tsplib(Source(file.path), "a cost is negative")
    return travel


Cells = Iterator[tuple[int, int]]
MATRIX_SHAPES: dict[str, Callable[[int], Cells]] = {
    "FULL_MATRIX": lambda n: ((i, j) for i in range(n) for j in range(n)),
    "UPPER_ROW": lambda n: ((i, j) for i in range(n) for j in range(i + 1, n)),
    "LOWER_ROW": lambda n: ((i, j) for i in range(n) for j in range(i)),
    "UPPER_DIAG_ROW": lambda n: ((i, j) for i in range(n) for j in range(i, n)),
    "LOWER_DIAG_ROW": lambda n: ((i, j) for i in range(n) for j in range(i + 1)),
    "UPPER_COL": lambda n: ((i, j) for j in range(n) for i in range(j)),
    "LOWER_COL": lambda n: ((i, j) for j in range(n) for i in range(j + 1, n)),
}


def is_tsplib(target: str) -> bool:
    """Whether a target is a TSPLIB file."""
    return is_file(Path(target)) and Path(target).suffix not in (".yaml", ".yml")


def visits_of_target(
    target: str, windows: Sequence[str] = (), lasts: Sequence[str] = (), before: Sequence[str] = ()
) -> TourVisits:
    """The visits that a target names, with windows ("m3=10..90"), durations ("m3=4") and orders
    ("m1, m2") beside.

    Raises `InvalidInput`.
    """
    demands = of_options(list(windows), list(lasts), list(before))
    if is_tsplib(target):
        read = read_tsplib(Path(target))
        visits = TourVisits(with_demands(read, demands), warnings=vanishing(read, Path(target)))
    else:
        problem = with_places(problem_of(target))
        if is_shared(problem):
            said, hint = (
                "several arms share the measurements",
                "ask for a plan: it says which arm makes what",
            )
            raise InvalidInput([Diagnostic(Source(target), "K404", said, hint)])
        parts = partition_by_tool(problem)
        visits = TourVisits(tour_problem(problem, parts, demands), parts, problem)
    require_known_visits(demands, {visit.name for visit in visits.tours.visits})
    return visits
