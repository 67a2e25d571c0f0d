"""Golden files: `golden/PROBLEM.json` beside `domain.yaml` holds the accepted answer of `problems/PROBLEM.yaml`.

A golden file is an ordinary answer, so `cellwright validate` checks the plan in it. The search is limited by
work, never by time, so that the answers are the same on every machine.
"""

import difflib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellwright.engine.authoring.testing.meaning import listing, meaning
from cellwright.engine.formats.report.json import envelope, outcome, status
from cellwright.engine.pipelines import objective, planning
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader import find, problem_files

FOLDER = "golden"


@dataclass(frozen=True, slots=True)
class GoldenComparison:
    """The answer to one problem and its golden file. `verdict` is same, different, new, or orphan (no such problem)."""

    name: str
    file: Path
    verdict: str
    meaning: tuple[str, ...] = ()
    diff: tuple[str, ...] = ()
    text: str = ""  # the answer as a golden file


def problems(target: str) -> tuple[Path, list[Path]]:
    """The golden folder of a target and its problem files. Raises `InvalidInput`."""
    path = find(target)
    if planning.loaded(path).problem is not None:
        folder = path.parent.parent if path.parent.name == "problems" else path.parent
        return folder / FOLDER, [path]
    return path.parent / FOLDER, problem_files(path)


def compare_all(target: str) -> Iterator[GoldenComparison]:
    """A comparison for each problem of a target, then one for each golden file without a problem. Raises `InvalidInput`."""
    folder, files = problems(target)
    wrong: list[Diagnostic] = []
    for file in files:
        try:
            yield compare(file, folder / f"{file.stem}.json")
        except InvalidInput as error:
            wrong += error.diagnostics
    if wrong:
        raise InvalidInput(wrong)
    if find(target) not in files:
        known = {file.stem for file in files}
        for file in sorted(folder.glob("*.json")):
            if file.stem not in known:
                yield GoldenComparison(
                    file.stem, file, "orphan", ("there is no problem of this name any more",)
                )


def compare(problem_file: Path, golden: Path) -> GoldenComparison:
    """Plan one problem and compare the answer with its golden file. Raises `InvalidInput`."""
    text = answer(problem_file)
    if not golden.is_file():
        return GoldenComparison(
            problem_file.stem, golden, "new", ("no answer has been accepted yet",), text=text
        )
    accepted = golden.read_text("utf-8", "replace")
    if accepted == text:
        return GoldenComparison(problem_file.stem, golden, "same", text=text)
    before, after = _parsed(accepted, golden), json.loads(text)
    diff = tuple(difflib.unified_diff(listing(before), listing(after), "golden", "now", lineterm="", n=2))
    return GoldenComparison(problem_file.stem, golden, "different", tuple(meaning(before, after)), diff, text)


def answer(problem_file: Path) -> str:
    """The answer to a problem, as the text of a golden file."""
    problem = planning.problem_of(str(problem_file))
    run = objective.plan(problem, Limits())
    return (
        envelope(status(run.outcome), outcome(run.outcome, problem, problem.domain.name, run.starts)) + "\n"
    )


def _parsed(text: str, file: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        hint = "restore it, or rewrite it with --update"
        raise InvalidInput([Diagnostic(Source(str(file)), "K413", f"not JSON: {error}", hint)]) from None


def update(comparison: GoldenComparison) -> None:
    """Accept an answer: write its golden file (completely or not at all), or remove an orphan. Raises `OSError`."""
    if comparison.verdict == "orphan":
        comparison.file.unlink()
        return
    comparison.file.parent.mkdir(exist_ok=True)
    part = comparison.file.with_suffix(f".{os.getpid()}.part")
    try:
        part.write_text(comparison.text, "utf-8")
        part.replace(comparison.file)
    finally:
        part.unlink(missing_ok=True)
