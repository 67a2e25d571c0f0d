"""S-LAB tables (Itoh et al. 2021): laboratory protocols with time constraints by mutual boundaries, as a shop.

A folder holds four tables, tab-separated, each with a line of headings: `machines` (number, type, name), `operations`
(job, operation, type of machine, duration, note), `dependency` (job, operation, operation that follows it) and `tcmb`
(job, operation, point, operation, point, longest time between the two points). Columns are found by their order; their
headings are ignored, and blank lines are skipped. Machines of one type are equal. An operation may wait beside its machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.shop import Job, Moment, Resource, Shop, Stage, Window
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.files import read_file
from cellwright.kb.numbers import DIGITS, NumberError, whole

TABLES = {"machines": 3, "operations": 4, "dependency": 3, "tcmb": 6}
POINTS = ("start", "end")
LONGEST = 10**9  # time units


def is_slab(path: Path) -> bool:
    """Whether a folder holds S-LAB tables."""
    return path.is_dir() and (path / "operations.tsv").is_file()


def read_slab(folder: Path) -> Shop:
    """The shop in a folder of S-LAB tables. Raises `InvalidInput` with all errors in all tables."""
    reader = _Reader([])
    rows = {name: list(reader.rows(folder / f"{name}.tsv", columns)) for name, columns in TABLES.items()}
    shop = reader.shop(rows)
    if reader.found:
        raise InvalidInput(reader.found)
    return shop


@dataclass(frozen=True, slots=True)
class Row:
    """The cells of a line, and its place."""

    cells: tuple[str, ...]
    where: Source


@dataclass
class _Reader:
    found: list[Diagnostic]

    def rows(self, path: Path, columns: int) -> Iterator[Row]:
        """The lines of a table below its headings, without blank lines."""
        try:
            lines = read_file(path).text.splitlines()
        except InvalidInput as error:
            self.found += error.diagnostics
            return
        for number, line in enumerate(lines[1:], 2):
            cells = tuple(cell.strip() for cell in line.split("\t"))
            if not any(cells):
                continue
            where = Source(str(path), number, text=line)
            if len(cells) < columns or not all(cells[:columns]):
                missing = f"{columns} columns are needed, but this line has {sum(map(bool, cells))}"
                self.found.append(Diagnostic(where, "K806", missing, "separate the columns by tabs"))
                continue
            yield Row(cells, where)

    def shop(self, rows: dict[str, list[Row]]) -> Shop:
        machines = _machines(rows["machines"])
        jobs: dict[str, list[Stage]] = {}
        stages: dict[str, Stage] = {}
        for row in rows["operations"]:
            stage = self._stage(row, machines)
            if stage.name in stages:
                self._report(row, "K104", f"operation {row.cells[1]} of job {row.cells[0]} is listed twice")
            stages[stage.name] = stage
            jobs.setdefault(row.cells[0], []).append(stage)
        windows = [w for row in rows["dependency"] for w in self._dependency(row, stages)]
        windows += [w for row in rows["tcmb"] for w in self._boundary(row, stages)]
        made = tuple(Job(name, tuple(each)) for name, each in jobs.items())
        return Shop(made, tuple(machines.values()), tuple(windows))

    def _report(self, row: Row, code: str, message: str, hint: str = "") -> None:
        self.found.append(Diagnostic(row.where, code, message, hint))

    def _stage(self, row: Row, machines: dict[str, Resource]) -> Stage:
        job, operation, machine, duration = row.cells[:4]
        if machine not in machines:
            self._report(
                row, "K101", f"there is no machine of type {machine}", nearest(machine, list(machines))
            )
        return Stage(f"{job}.{operation}", self._number(row, duration), (f"type {machine}",))

    def _number(self, row: Row, text: str) -> int:
        try:
            return whole(text, 0, LONGEST)
        except NumberError as error:
            self._report(row, "K103", f"'{text[:DIGITS]}' {error}, so it is no time")
            return 0

    def _dependency(self, row: Row, stages: dict[str, Stage]) -> Iterator[Window]:
        job, earlier, later = row.cells[:3]
        pair = self._known(row, f"{job}.{earlier}", stages), self._known(row, f"{job}.{later}", stages)
        if pair[0] and pair[1]:
            yield Window(Moment(pair[0].name, pair[0].duration), Moment(pair[1].name))

    def _boundary(self, row: Row, stages: dict[str, Stage]) -> Iterator[Window]:
        """The window between two points: the longest time from the first to the second."""
        job, one, point, other, second, limit = row.cells[:6]
        first = self._moment(row, f"{job}.{one}", point, stages)
        last = self._moment(row, f"{job}.{other}", second, stages)
        most = self._number(row, limit)
        if first and last:
            yield Window(first, last, least=-most, most=most)

    def _moment(self, row: Row, name: str, point: str, stages: dict[str, Stage]) -> Moment | None:
        if point not in POINTS:
            self._report(row, "K806", f"'{point}' is not a point of an operation", nearest(point, POINTS))
        stage = self._known(row, name, stages)
        return Moment(name, stage.duration if point == "end" else 0) if stage else None

    def _known(self, row: Row, name: str, stages: dict[str, Stage]) -> Stage | None:
        if name not in stages:
            self._report(row, "K101", f"there is no operation {name}", nearest(name, list(stages)))
        return stages.get(name)


def _machines(rows: list[Row]) -> dict[str, Resource]:
    """One resource per type, with its machines as units."""
    types: dict[str, list[str]] = {}
    for row in rows:
        types.setdefault(row.cells[1], []).append(row.cells[2])
    return {kind: Resource(f"type {kind}", len(names), units=tuple(names)) for kind, names in types.items()}
