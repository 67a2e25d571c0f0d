"""Golden files: a problem's accepted answer, compared with a new one in words.

A golden file is an ordinary answer, so `cellwright validate` checks the plan in it. The search is
limited by work, never by time, so that the answers are the same on every machine.
"""

import difflib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellwright.engine.formats.report.json_answers import (
    json_envelope,
    outcome_entry,
    outcome_status,
)
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.pipelines.planning import checked_plan, plan_objective
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader import find_target, problem_files

Envelope = Mapping[str, Any]


def answer_listing(answer: Envelope) -> list[str]:
    """An answer with one line per goal, step and order, for comparing line by line."""
    lines = [f"status: {answer.get('status')}", *(f"goal: {goal}" for goal in _goal_lines(answer))]
    if reason := answer["data"].get("reason"):
        lines.append(f"reason: {reason}")
    lines += [f"cost: {_answer_plan(answer)['cost']}"] if "cost" in _answer_plan(answer) else []
    for step in _answer_plan(answer).get("steps", ()):
        after = f"  after {', '.join(map(str, step['after']))}" if step["after"] else ""
        lines.append(f"{step['id']} {step['operator']}{after}")
    return lines


def describe_difference(before: Envelope, after: Envelope) -> Iterator[str]:
    """The differences that matter, from goals down to orders."""
    yield "same goals" if _goal_lines(before) == _goal_lines(after) else "other goals"
    if before.get("status") != after.get("status"):
        yield f"{before.get('status')} -> {after.get('status')}"
    if not (_answer_plan(before) and _answer_plan(after)):
        if before["data"].get("reason") != after["data"].get("reason"):
            yield "another reason"
        return
    for figure in ("cost", "makespan"):
        old, new = _answer_plan(before).get(figure), _answer_plan(after).get(figure)
        if old != new:
            yield f"{figure} {old} -> {new}"
    yield from _step_differences(_operator_names(before), _operator_names(after))
    if _operator_names(before) == _operator_names(after):
        yield from _order_differences(before, after)


def _step_differences(before: Sequence[str], after: Sequence[str]) -> Iterator[str]:
    gone, new = Counter(before) - Counter(after), Counter(after) - Counter(before)
    if gone:
        yield f"{count_noun(gone.total(), 'step')} gone: {_count_steps(gone)}"
    if new:
        yield f"{count_noun(new.total(), 'step')} new: {_count_steps(new)}"
    if not gone and not new and list(before) != list(after):
        matcher = difflib.SequenceMatcher(None, before, after, autojunk=False)
        kept = sum(block.size for block in matcher.get_matching_blocks())
        yield f"{count_noun(len(before) - kept, 'step')} reordered"


def _order_differences(before: Envelope, after: Envelope) -> Iterator[str]:
    """Differences between two plans of the same steps in the same list order."""
    old, new = _ordered_pairs(before), _ordered_pairs(after)
    if old - new:
        yield f"{count_noun(len(old - new), 'order')} dropped"
    if new - old:
        yield f"{count_noun(len(new - old), 'order')} added"
    if old == new and before != after:
        yield "same steps and orders, other links or details"


def _ordered_pairs(answer: Envelope) -> set[tuple[int, int]]:
    return {
        (earlier, step["id"]) for step in _answer_plan(answer)["steps"] for earlier in step["after"]
    }


def _answer_plan(answer: Envelope) -> Mapping[str, Any]:
    plan_data: Mapping[str, Any] = answer["data"].get("plan", {})
    return plan_data


def _goal_lines(answer: Envelope) -> list[str]:
    problem = _answer_plan(answer).get("problem") or answer["data"].get("problem", {})
    return [*problem.get("goals", ()), *(entry["stages"] for entry in problem.get("workflow", ()))]


def _operator_names(answer: Envelope) -> list[str]:
    return [step["operator"] for step in _answer_plan(answer)["steps"]]


def _count_steps(steps: Counter[str]) -> str:
    names = [f"{name} x{count}" if count > 1 else name for name, count in sorted(steps.items())]
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


GOLDEN_FOLDER = "golden"


@dataclass(frozen=True, slots=True)
class GoldenComparison:
    """The answer to one problem and its golden file.

    `verdict` is same, different, new, or orphan (no such problem).
    """

    name: str
    file: Path
    verdict: str
    meaning: tuple[str, ...] = ()
    diff: tuple[str, ...] = ()
    text: str = ""  # the answer as a golden file


def golden_problems(target: str) -> tuple[Path, list[Path]]:
    """The golden folder of a target and its problem files. Raises `InvalidInput`."""
    path = find_target(target)
    if checked_plan.load_target(path).problem is not None:
        folder = path.parent.parent if path.parent.name == "problems" else path.parent
        return folder / GOLDEN_FOLDER, [path]
    return path.parent / GOLDEN_FOLDER, problem_files(path)


def compare_all(
    target: str, begin: Callable[[str], None] = lambda _name: None
) -> Iterator[GoldenComparison]:
    """A comparison for each problem of a target, then one for each golden file without a problem.
    Raises `InvalidInput`.

    `begin` hears the name of each problem before it is planned.
    """
    folder, files = golden_problems(target)
    wrong: list[Diagnostic] = []
    for file in files:
        begin(file.stem)
        try:
            yield compare_with_golden(file, folder / f"{file.stem}.json")
        except InvalidInput as error:
            wrong += error.diagnostics
    if wrong:
        raise InvalidInput(wrong)
    if find_target(target) not in files:
        known = {file.stem for file in files}
        for file in sorted(folder.glob("*.json")):
            if file.stem not in known:
                yield GoldenComparison(
                    file.stem, file, "orphan", ("there is no problem of this name any more",)
                )


def compare_with_golden(problem_file: Path, golden: Path) -> GoldenComparison:
    """Plan one problem and compare the answer with its golden file. Raises `InvalidInput`."""
    text = golden_answer(problem_file)
    if not golden.is_file():
        return GoldenComparison(
            problem_file.stem, golden, "new", ("no answer has been accepted yet",), text=text
        )
    accepted = golden.read_text("utf-8", "replace")
    if accepted == text:
        return GoldenComparison(problem_file.stem, golden, "same", text=text)
    before, after = _parse_answer(accepted, golden), json.loads(text)
    diff = tuple(
        difflib.unified_diff(
            answer_listing(before), answer_listing(after), "golden", "now", lineterm="", n=2
        )
    )
    return GoldenComparison(
        problem_file.stem,
        golden,
        "different",
        tuple(describe_difference(before, after)),
        diff,
        text,
    )


def golden_answer(problem_file: Path) -> str:
    """The answer to a problem, as the text of a golden file."""
    problem = checked_plan.problem_of(str(problem_file))
    run = plan_objective.plan_for_objective(problem, SearchLimits())
    return (
        json_envelope(
            outcome_status(run.outcome),
            outcome_entry(run.outcome, problem, problem.domain.name, run.starts),
        )
        + "\n"
    )


def _parse_answer(text: str, file: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        hint = "restore it, or rewrite it with --update"
        raise InvalidInput(
            [Diagnostic(Source(str(file)), "K413", f"not JSON: {error}", hint)]
        ) from None


def accept_answer(comparison: GoldenComparison) -> None:
    """Accept an answer: write its golden file (completely or not at all), or remove an orphan.

    Raises `OSError`.
    """
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
