"""Learn MACROPs from plans in files, and exchange MACROPs between libraries as files."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.reuse.subsequences import SIGNATURE
from cellwright.engine.stages.macros.learning.generalise import NotGeneral, generalise
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.macros.lookup.repertoire import record_of
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, escaped
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parsed
from cellwright.kb.model.macro import Macrop
from cellwright.kb.store import Library, NotationError, Record, document, macrop_of

VERSION = 1
MAX_BYTES = 1024 * 2**20  # of a file of MACROPs


@dataclass(frozen=True, slots=True)
class Lesson:
    """What was learned from one plan: the number and name of its MACROP, or the reason why there is none."""

    file: Path
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()

    def __str__(self) -> str:
        return (
            f"learned as MACROP {self.macrop}, {self.name}" if self.macrop else f"not learned: {self.reason}"
        )


def lesson(file: Path, library: Library) -> Lesson:
    """Learn from the plan in a file if the independent checker accepts it. Raises `InvalidInput`."""
    problem, plan = planning.plan_in(file)
    wrong = planning.check_plan(problem, plan, str(file))
    if wrong:
        return Lesson(file, reason="the plan is not valid", diagnostics=tuple(wrong))
    try:
        learned = generalise(problem, plan, CellDomain(problem), Semantics(problem).initial()).macrop
    except NotGeneral as error:
        return Lesson(file, reason=str(error))
    (number,) = library.add(records([learned]))
    return Lesson(file, number, str(learned.name), "" if number is not None else "the library has it already")


def records(macrops: Iterable[Macrop]) -> list[Record]:
    """MACROPs as records of a library."""
    return [Record(each, SIGNATURE) if each.subsequence else record_of(each) for each in macrops]


def write(file: Path, macrops: Iterable[Macrop]) -> None:
    """Write MACROPs as JSON. Raises `InvalidInput` if the file cannot be written."""
    whole = {"version": VERSION, "macrops": list(map(document, macrops))}
    try:
        file.write_text(escaped(json.dumps(whole, indent=1, ensure_ascii=False)) + "\n", encoding="utf-8")
    except OSError as error:
        raise _refused(file, "K415", f"cannot be written: {error.strerror}") from error


def read(file: Path) -> list[Macrop]:
    """The MACROPs in a file that `write` has made. Raises `InvalidInput` if it cannot be read or is no such file."""
    try:
        whole = parsed(read_file(file, most=MAX_BYTES).text)
        if whole["version"] != VERSION:
            raise _refused(file, "K413", f"this is format {whole['version']}, not {VERSION}")
        return list(map(macrop_of, whole["macrops"]))
    except (NotationError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise _refused(file, "K413", f"the file does not hold MACROPs: {error}") from error


def _refused(file: Path, code: str, message: str) -> InvalidInput:
    hint = "write one with `cellwright macros export FILE`"
    return InvalidInput([Diagnostic(Source(str(file)), code, message, hint)])
