"""Job-shop instances as shops: each job visits machines in its own order, one stage after another.

Two notations are read. In JSON, each named object has a `duration_matrix` and a `machines_matrix`, with one row per job. In
the plain text of the benchmark libraries, a line holds the numbers of jobs and machines; then each job has a line with pairs
of machine and duration.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeGuard

from cellwright.engine.model.shop import Job, Resource, Shop, Stage, in_order
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.numbers import NumberError, whole

LONGEST = 10**9  # time units, and also the largest number of a machine
Rows = Sequence[Sequence[tuple[int, int]]]  # per job: machine and duration of each stage


def read_jobshop(path: Path, instance: str = "") -> Shop:
    """The shop in a file; `instance` names one of several. Raises `InvalidInput`."""
    text = read_file(path).text
    rows = _from_json(path, text, instance) if text.lstrip().startswith("{") else _from_text(path, text)
    return _shop(rows)


def instances(path: Path) -> tuple[str, ...]:
    """The names of the instances in a JSON file; empty for plain text. Raises `InvalidInput`."""
    text = read_file(path).text
    return tuple(_parsed(path, text)) if text.lstrip().startswith("{") else ()


def _invalid(path: Path, code: str, message: str, hint: str = "", line: int = 0) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path), line), code, message, hint)])


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        found = parsed(text)
    except ValueError as error:
        raise _invalid(path, "K806", f"not JSON: {error}") from None
    if "duration_matrix" in found:
        return {path.stem: found}
    return dict(found)


def _from_json(path: Path, text: str, instance: str) -> Rows:
    found = _parsed(path, text)
    if not instance and len(found) == 1:
        instance = next(iter(found))
    if instance not in found:
        message = f"no instance '{instance}'" if instance else "the file holds several instances; name one"
        hint = nearest(instance, list(found)) or f"one of {', '.join(found)}"
        raise _invalid(path, "K406" if instance else "K409", message, hint)
    entry = found[instance] if isinstance(found[instance], dict) else {}
    machines, durations = entry.get("machines_matrix"), entry.get("duration_matrix")
    if not _is_matrix(machines) or not _is_matrix(durations):
        raise _invalid(
            path, "K806", f"{instance} needs duration_matrix and machines_matrix, in whole numbers"
        )
    if [len(row) for row in machines] != [len(row) for row in durations]:
        raise _invalid(path, "K806", f"the matrices of {instance} differ in shape")
    return [list(zip(*rows, strict=True)) for rows in zip(machines, durations, strict=True)]


def _is_matrix(value: object) -> TypeGuard[list[list[int]]]:
    return isinstance(value, list) and all(
        isinstance(row, list) and all(type(cell) is int and 0 <= cell <= LONGEST for cell in row)
        for row in value
    )


def _from_text(path: Path, text: str) -> Rows:
    lines = [(n, line.split()) for n, line in enumerate(text.splitlines(), 1)]
    kept = [(n, numbers) for n, cells in lines if cells and (numbers := _wholes(cells)) is not None]
    if not kept or len(kept[0][1]) != 2:
        raise _invalid(path, "K806", "no line with the numbers of jobs and machines")
    jobs, machines = kept[0][1]
    if len(kept) != jobs + 1:
        raise _invalid(
            path, "K806", f"{jobs} jobs are announced, but {len(kept) - 1} lines of numbers follow"
        )
    rows = []
    for line, numbers in kept[1:]:
        if len(numbers) % 2 or any(machine >= machines for machine in numbers[::2]):
            raise _invalid(
                path, "K806", f"expected pairs of a machine number below {machines} and a duration", line=line
            )
        rows.append(list(zip(numbers[::2], numbers[1::2], strict=True)))
    return rows


def _wholes(cells: Sequence[str]) -> list[int] | None:
    """The numbers in the cells of a line; None if a cell holds none, or one that is too large."""
    try:
        return [whole(cell, 0, LONGEST) for cell in cells]
    except NumberError:
        return None


def _shop(rows: Rows) -> Shop:
    jobs = tuple(
        Job(
            f"job {number}",
            tuple(
                Stage(f"{number}.{place}", lasts, (f"machine {machine}",))
                for place, (machine, lasts) in enumerate(row)
            ),
        )
        for number, row in enumerate(rows)
    )
    machines = sorted({machine for row in rows for machine, _ in row})
    windows = tuple(window for job in jobs for window in in_order(job.stages))
    return Shop(jobs, tuple(Resource(f"machine {machine}") for machine in machines), windows)
