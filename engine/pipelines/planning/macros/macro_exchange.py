"""Learns MACROPs from plan files, and writes and reads files of MACROPs for other libraries."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros.macro_subsequences import SUBSEQUENCE_SIGNATURE
from cellwright.engine.stages.lifted.cell_domain import CellDomain
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_repertoire import macro_record
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, escape_controls
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.store import Library, NotationError, Record, document, macrop_of

MACRO_FILE_VERSION = 1
MAX_MACRO_FILE_BYTES = 1024 * 2**20  # of a file of MACROPs


@dataclass(frozen=True, slots=True)
class Lesson:
    """What was learned from one plan: the number and name of its MACROP, or the reason why
    there is none.
    """

    file: Path
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()

    def __str__(self) -> str:
        return (
            f"learned as MACROP {self.macrop}, {self.name}"
            if self.macrop
            else f"not learned: {self.reason}"
        )


def learn_from_file(file: Path, library: Library) -> Lesson:
    """Learn from the plan in a file if the independent checker accepts it.

    Raises `InvalidInput`.
    """
    problem, plan = checked_plan.plan_in(file)
    wrong = checked_plan.check_plan(problem, plan, str(file))
    if wrong:
        return Lesson(file, reason="the plan is not valid", diagnostics=tuple(wrong))
    try:
        learned = generalise_plan(
            problem, plan, CellDomain(problem), Semantics(problem).initial()
        ).macrop
    except NotGeneral as error:
        return Lesson(file, reason=str(error))
    (number,) = library.add(macro_records([learned]))
    return Lesson(
        file, number, str(learned.name), "" if number is not None else "the library has it already"
    )


def macro_records(macrops: Iterable[Macrop]) -> list[Record]:
    """MACROPs as records of a library."""
    return [
        Record(macrop, SUBSEQUENCE_SIGNATURE) if macrop.subsequence else macro_record(macrop)
        for macrop in macrops
    ]


def write_macros(file: Path, macrops: Iterable[Macrop]) -> None:
    """Write MACROPs as JSON. Raises `InvalidInput` if the file cannot be written."""
    whole = {"version": MACRO_FILE_VERSION, "macrops": list(map(document, macrops))}
    try:
        file.write_text(
            escape_controls(json.dumps(whole, indent=1, ensure_ascii=False)) + "\n",
            encoding="utf-8",
        )
    except OSError as error:
        raise _refuse_file(file, "K415", f"cannot be written: {error.strerror}") from error


def read_macros(file: Path) -> list[Macrop]:
    """The MACROPs in a file that `write` has made.

    Raises `InvalidInput` if it cannot be read or is no such file.
    """
    try:
        whole = parse_json(read_file(file, most=MAX_MACRO_FILE_BYTES).text)
        if whole["version"] != MACRO_FILE_VERSION:
            raise _refuse_file(
                file, "K413", f"this is format {whole['version']}, not {MACRO_FILE_VERSION}"
            )
        return list(map(macrop_of, whole["macrops"]))
    except (NotationError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise _refuse_file(file, "K413", f"the file does not hold MACROPs: {error}") from error


def _refuse_file(file: Path, code: str, message: str) -> InvalidInput:
    hint = "write one with `cellwright macros export FILE`"
    return InvalidInput([Diagnostic(Source(str(file)), code, message, hint)])
