"""What is known of a plan whose steps last as long as they like, in words and as data."""

from collections.abc import Iterator
from typing import Any

from cellwright.engine.model.robustness import RobustPlan, rules_entry

MAX_LINES = 12  # windows, or parts of a cycle, that are named


def robustness_lines(robust: RobustPlan, unit: str) -> Iterator[str]:
    """The answer for people."""
    if robust.learned:
        yield "Ranges learned from journals:"
        yield from _list_lines(robust.learned)
    if robust.is_robust:
        yield from _policy_lines(robust, unit)
        return
    yield (
        "Not robust: no policy keeps all windows whatever happens in the ranges. "
        f"These do not go together; {robust.lacks} {unit} are missing:"
    )
    yield from _list_lines(robust.cycle)
    yield from _relaxation_lines(robust, unit)
    if robust.chances:
        yield f"As it is, all windows are kept with a chance of {_percent(robust.kept)}:"
        by_chance = sorted(robust.chances, key=lambda chance: (chance.chance, chance.says))
        yield from _list_lines([f"{c.says}: {_percent(c.chance)}" for c in by_chance])


def _policy_lines(robust: RobustPlan, unit: str) -> Iterator[str]:
    waits = sum(len(rule.waits) for rule in robust.rules.values())
    windows = f"{len(robust.chances)} window{'' if len(robust.chances) == 1 else 's'}"
    steps = f"{robust.varying} step{'' if robust.varying == 1 else 's'}"
    waiting = f"{waits} wait{'' if waits == 1 else 's'}"
    yield (
        f"Robust: with {steps} of uncertain duration, a policy with {waiting} keeps {windows} "
        f"whatever happens. All has ended after {robust.worst_end} {unit} at the latest."
    )
    if robust.chances and robust.kept < 1.0:
        kept = _percent(robust.kept)
        yield f"Without the policy, all windows are kept with a chance of {kept}."
    for note in robust.notes:
        yield f"For this, {note}."


def _relaxation_lines(robust: RobustPlan, unit: str) -> Iterator[str]:
    if robust.widened is None:
        yield "No wider window helps: the steps themselves do not fit."
    else:
        yield "The least that windows would have to be wider:"
        yield from _list_lines(
            [f"{window.says}: {window.by} {unit} more" for window in robust.widened]
        )
    if robust.narrowed is not None:
        yield (
            "A policy exists within these ranges, which hold with a chance of "
            f"{_percent(robust.within)}; no narrower ranges cost less:"
        )
        yield from _list_lines(
            [
                f"{r.step} {r.operator}: {r.after[0]} to {r.after[1]} {unit}, "
                f"not {r.before[0]} to {r.before[1]}"
                for r in robust.narrowed
            ]
        )


def _list_lines(lines: "tuple[str, ...] | list[str]") -> Iterator[str]:
    yield from (f"  - {line}" for line in lines[:MAX_LINES])
    if len(lines) > MAX_LINES:
        yield f"  - and {len(lines) - MAX_LINES} more (--format json has all)"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def robustness_entry(robust: RobustPlan) -> dict[str, Any]:
    """The answer for programs."""
    entry: dict[str, Any] = {
        "robust": robust.is_robust,
        "uncertain_steps": robust.varying,
        "windows": [chance.entry() for chance in robust.chances],
        "kept_without_policy": round(robust.kept, 4),
    }
    entry |= {"learned": list(robust.learned)} if robust.learned else {}
    if robust.is_robust:
        return entry | {"latest_end": robust.worst_end, "policy": rules_entry(robust.rules)}
    entry |= {"cycle": list(robust.cycle), "lacks": robust.lacks}
    if robust.widened is not None:
        entry["widen"] = [window.entry() for window in robust.widened]
    if robust.narrowed is not None:
        entry["narrow"] = {
            "ranges": [narrowed.entry() for narrowed in robust.narrowed],
            "chance": round(robust.within, 4),
            "policy": rules_entry(robust.narrowed_rules),
        }
    return entry
