"""Scheduling problems (shops) from job-shop instances and from S-LAB laboratory tables.

Two notations are read. In JSON, each named object has a `duration_matrix` and a `machines_matrix`,
with one row per job. In the plain text of the benchmark libraries, a line holds the numbers of jobs
and machines; then each job has a line with pairs of machine and duration.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from cellwright.engine.model.shop_scheduling import (
    Resource,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
    chain_windows,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.loader.plan import is_plan
from cellwright.kb.numbers import MAX_NUMBER_CHARACTERS, NumberError, read_whole

MAX_JOBSHOP_NUMBER = 10**9  # time units, and also the largest number of a machine
Rows = Sequence[Sequence[tuple[int, int]]]  # per job: machine and duration of each stage


def read_jobshop(path: Path, instance: str = "") -> Shop:
    """The shop in a file; `instance` names one of several. Raises `InvalidInput`."""
    text = read_file(path).text
    rows = (
        _from_json(path, text, instance)
        if text.lstrip().startswith("{")
        else _from_text(path, text)
    )
    return _shop_of_rows(rows)


def instance_names(path: Path) -> tuple[str, ...]:
    """The names of the instances in a JSON file; empty for plain text. Raises `InvalidInput`."""
    text = read_file(path).text
    return tuple(_parse_instances(path, text)) if text.lstrip().startswith("{") else ()


def _bad_instance(
    path: Path, code: str, message: str, hint: str = "", line: int = 0
) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path), line), code, message, hint)])


def _parse_instances(path: Path, text: str) -> dict[str, Any]:
    try:
        document = parse_json(text)
    except ValueError as error:
        raise _bad_instance(path, "K806", f"not JSON: {error}") from None
    if "duration_matrix" in document:
        return {path.stem: document}
    return dict(document)


def _from_json(path: Path, text: str, instance: str) -> Rows:
    shop_instances = _parse_instances(path, text)
    if not instance and len(shop_instances) == 1:
        instance = next(iter(shop_instances))
    if instance not in shop_instances:
        message = (
            f"no instance '{instance}'"
            if instance
            else "the file holds several instances; name one"
        )
        hint = nearest_hint(instance, list(shop_instances)) or f"one of {', '.join(shop_instances)}"
        raise _bad_instance(path, "K406" if instance else "K409", message, hint)
    entry = shop_instances[instance] if isinstance(shop_instances[instance], dict) else {}
    machines, durations = entry.get("machines_matrix"), entry.get("duration_matrix")
    if not _is_matrix(machines) or not _is_matrix(durations):
        raise _bad_instance(
            path, "K806", f"{instance} needs duration_matrix and machines_matrix, in whole numbers"
        )
    if [len(row) for row in machines] != [len(row) for row in durations]:
        raise _bad_instance(path, "K806", f"the matrices of {instance} differ in shape")
    return [list(zip(*rows, strict=True)) for rows in zip(machines, durations, strict=True)]


def _is_matrix(value: object) -> TypeGuard[list[list[int]]]:
    return isinstance(value, list) and all(
        isinstance(row, list)
        and all(type(cell) is int and 0 <= cell <= MAX_JOBSHOP_NUMBER for cell in row)
        for row in value
    )


def _from_text(path: Path, text: str) -> Rows:
    lines = [(n, line.split()) for n, line in enumerate(text.splitlines(), 1)]
    kept = [
        (n, numbers)
        for n, cells in lines
        if cells and (numbers := _whole_numbers(cells)) is not None
    ]
    if not kept or len(kept[0][1]) != 2:
        raise _bad_instance(path, "K806", "no line with the numbers of jobs and machines")
    jobs, machines = kept[0][1]
    if len(kept) != jobs + 1:
        raise _bad_instance(
            path, "K806", f"{jobs} jobs are announced, but {len(kept) - 1} lines of numbers follow"
        )
    rows = []
    for line, numbers in kept[1:]:
        if len(numbers) % 2 or any(machine >= machines for machine in numbers[::2]):
            raise _bad_instance(
                path,
                "K806",
                f"expected pairs of a machine number below {machines} and a duration",
                line=line,
            )
        rows.append(list(zip(numbers[::2], numbers[1::2], strict=True)))
    return rows


def _whole_numbers(cells: Sequence[str]) -> list[int] | None:
    """The numbers in the cells of a line; None if a cell holds none, or one that is too large."""
    try:
        return [read_whole(cell, 0, MAX_JOBSHOP_NUMBER) for cell in cells]
    except NumberError:
        return None


def _shop_of_rows(rows: Rows) -> Shop:
    jobs = tuple(
        ShopJob(
            f"job {number}",
            tuple(
                ShopStage(f"{number}.{place}", lasts, (f"machine {machine}",))
                for place, (machine, lasts) in enumerate(row)
            ),
        )
        for number, row in enumerate(rows)
    )
    machines = sorted({machine for row in rows for machine, _ in row})
    windows = tuple(window for job in jobs for window in chain_windows(job.stages))
    return Shop(jobs, tuple(Resource(f"machine {machine}") for machine in machines), windows)


TABLE_WIDTHS = {"machines": 3, "operations": 4, "dependency": 3, "tcmb": 6}
STEP_POINTS = ("start", "end")
MAX_SLAB_TIME = 10**9  # time units


def is_slab(path: Path) -> bool:
    """Whether a folder holds S-LAB tables."""
    return path.is_dir() and (path / "operations.tsv").is_file()


def read_slab(folder: Path) -> Shop:
    """The shop in a folder of S-LAB tables. Raises `InvalidInput` with all errors in all tables."""
    reader = _Reader([])
    rows = {
        name: list(reader.rows(folder / f"{name}.tsv", columns))
        for name, columns in TABLE_WIDTHS.items()
    }
    shop = reader.shop(rows)
    if reader.found:
        raise InvalidInput(reader.found)
    return shop


@dataclass(frozen=True, slots=True)
class TableRow:
    """The cells of a line, and its place."""

    cells: tuple[str, ...]
    where: Source


@dataclass
class _Reader:
    found: list[Diagnostic]

    def rows(self, path: Path, columns: int) -> Iterator[TableRow]:
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
                self.found.append(
                    Diagnostic(where, "K806", missing, "separate the columns by tabs")
                )
                continue
            yield TableRow(cells, where)

    def shop(self, rows: dict[str, list[TableRow]]) -> Shop:
        machines = _machine_resources(rows["machines"])
        jobs: dict[str, list[ShopStage]] = {}
        stages: dict[str, ShopStage] = {}
        for row in rows["operations"]:
            stage = self._stage(row, machines)
            if stage.name in stages:
                self._report(
                    row, "K104", f"operation {row.cells[1]} of job {row.cells[0]} is listed twice"
                )
            stages[stage.name] = stage
            jobs.setdefault(row.cells[0], []).append(stage)
        windows = [w for row in rows["dependency"] for w in self._dependency(row, stages)]
        windows += [w for row in rows["tcmb"] for w in self._boundary(row, stages)]
        jobs_read = tuple(ShopJob(name, tuple(steps)) for name, steps in jobs.items())
        return Shop(jobs_read, tuple(machines.values()), tuple(windows))

    def _report(self, row: TableRow, code: str, message: str, hint: str = "") -> None:
        self.found.append(Diagnostic(row.where, code, message, hint))

    def _stage(self, row: TableRow, machines: dict[str, Resource]) -> ShopStage:
        job, operation, machine, duration = row.cells[:4]
        if machine not in machines:
            self._report(
                row,
                "K101",
                f"there is no machine of type {machine}",
                nearest_hint(machine, list(machines)),
            )
        return ShopStage(f"{job}.{operation}", self._number(row, duration), (f"type {machine}",))

    def _number(self, row: TableRow, text: str) -> int:
        try:
            return read_whole(text, 0, MAX_SLAB_TIME)
        except NumberError as error:
            self._report(row, "K103", f"'{text[:MAX_NUMBER_CHARACTERS]}' {error}, so it is no time")
            return 0

    def _dependency(self, row: TableRow, stages: dict[str, ShopStage]) -> Iterator[StageWindow]:
        job, earlier, later = row.cells[:3]
        pair = (
            self._known(row, f"{job}.{earlier}", stages),
            self._known(row, f"{job}.{later}", stages),
        )
        if pair[0] and pair[1]:
            yield StageWindow(
                StageMoment(pair[0].name, pair[0].duration), StageMoment(pair[1].name)
            )

    def _boundary(self, row: TableRow, stages: dict[str, ShopStage]) -> Iterator[StageWindow]:
        """The window between two points: the longest time from the first to the second."""
        job, one, point, other_step, second, limit = row.cells[:6]
        first = self._moment(row, f"{job}.{one}", point, stages)
        last = self._moment(row, f"{job}.{other_step}", second, stages)
        most = self._number(row, limit)
        if first and last:
            yield StageWindow(first, last, least=-most, most=most)

    def _moment(
        self, row: TableRow, name: str, point: str, stages: dict[str, ShopStage]
    ) -> StageMoment | None:
        if point not in STEP_POINTS:
            self._report(
                row,
                "K806",
                f"'{point}' is not a point of an operation",
                nearest_hint(point, STEP_POINTS),
            )
        stage = self._known(row, name, stages)
        return StageMoment(name, stage.duration if point == "end" else 0) if stage else None

    def _known(self, row: TableRow, name: str, stages: dict[str, ShopStage]) -> ShopStage | None:
        if name not in stages:
            self._report(
                row, "K101", f"there is no operation {name}", nearest_hint(name, list(stages))
            )
        return stages.get(name)


def _machine_resources(rows: list[TableRow]) -> dict[str, Resource]:
    """One resource per type, with its machines as units."""
    types: dict[str, list[str]] = {}
    for row in rows:
        types.setdefault(row.cells[1], []).append(row.cells[2])
    return {
        kind: Resource(f"type {kind}", len(names), units=tuple(names))
        for kind, names in types.items()
    }


JOB_SHOPS = (".json", ".txt", ".jss", ".jsp")


def shop_of(path: Path, instance: str = "") -> Shop | None:
    """The shop in a folder of S-LAB tables or a job-shop file; None if it is neither. Raises
    `InvalidInput`.
    """
    if is_slab(path):
        return read_slab(path)
    if path.is_file() and path.suffix in JOB_SHOPS and not is_plan(path):
        return read_jobshop(path, instance)
    return None
