"""What a difference between two answers means, in a few short phrases."""

import difflib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cellwright.engine.model.wording import counted

Envelope = Mapping[str, Any]


def listing(answer: Envelope) -> list[str]:
    """An answer with one line per goal, step and order, for comparing line by line."""
    lines = [f"status: {answer.get('status')}", *(f"goal: {goal}" for goal in _goals(answer))]
    if reason := answer["data"].get("reason"):
        lines.append(f"reason: {reason}")
    lines += [f"cost: {_plan(answer)['cost']}"] if "cost" in _plan(answer) else []
    for step in _plan(answer).get("steps", ()):
        after = f"  after {', '.join(map(str, step['after']))}" if step["after"] else ""
        lines.append(f"{step['id']} {step['operator']}{after}")
    return lines


def meaning(before: Envelope, after: Envelope) -> Iterator[str]:
    """The differences that matter, from goals down to orders."""
    yield "same goals" if _goals(before) == _goals(after) else "other goals"
    if before.get("status") != after.get("status"):
        yield f"{before.get('status')} -> {after.get('status')}"
    if not (_plan(before) and _plan(after)):
        if before["data"].get("reason") != after["data"].get("reason"):
            yield "another reason"
        return
    for figure in ("cost", "makespan"):
        old, new = _plan(before).get(figure), _plan(after).get(figure)
        if old != new:
            yield f"{figure} {old} -> {new}"
    yield from _steps(_operators(before), _operators(after))
    if _operators(before) == _operators(after):
        yield from _orders(before, after)


def _steps(before: Sequence[str], after: Sequence[str]) -> Iterator[str]:
    gone, new = Counter(before) - Counter(after), Counter(after) - Counter(before)
    if gone:
        yield f"{counted(gone.total(), 'step')} gone: {_named(gone)}"
    if new:
        yield f"{counted(new.total(), 'step')} new: {_named(new)}"
    if not gone and not new and list(before) != list(after):
        matcher = difflib.SequenceMatcher(None, before, after, autojunk=False)
        kept = sum(block.size for block in matcher.get_matching_blocks())
        yield f"{counted(len(before) - kept, 'step')} reordered"


def _orders(before: Envelope, after: Envelope) -> Iterator[str]:
    """Differences between two plans of the same steps in the same list order."""
    old, new = _ordered_pairs(before), _ordered_pairs(after)
    if old - new:
        yield f"{counted(len(old - new), 'order')} dropped"
    if new - old:
        yield f"{counted(len(new - old), 'order')} added"
    if old == new and before != after:
        yield "same steps and orders, other links or details"


def _ordered_pairs(answer: Envelope) -> set[tuple[int, int]]:
    return {(earlier, step["id"]) for step in _plan(answer)["steps"] for earlier in step["after"]}


def _plan(answer: Envelope) -> Mapping[str, Any]:
    found: Mapping[str, Any] = answer["data"].get("plan", {})
    return found


def _goals(answer: Envelope) -> list[str]:
    problem = _plan(answer).get("problem") or answer["data"].get("problem", {})
    return [*problem.get("goals", ()), *(entry["stages"] for entry in problem.get("workflow", ()))]


def _operators(answer: Envelope) -> list[str]:
    return [step["operator"] for step in _plan(answer)["steps"]]


def _named(steps: Counter[str]) -> str:
    names = [f"{name} x{count}" if count > 1 else name for name, count in sorted(steps.items())]
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
