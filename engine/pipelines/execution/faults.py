"""Faults that a person orders for a simulated run: which steps of the plan they are about, and whether they can occur there."""

import re
from collections.abc import Iterable
from dataclasses import replace

from cellwright.engine.pipelines.execution.planned import Ready
from cellwright.engine.pipelines.simulator import possible
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest, unknown_name
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.numbers import is_count
from cellwright.kb.terms import Function

WHERE = Source("--fault")


def settled(text: str, ready: Ready, base: FaultModel | None) -> str:
    """Faults as a simulator reads them: STEP#TIME=CAUSE; a number is a step of the plan. Raises `InvalidInput`."""
    return "; ".join(_settled(each.strip(), ready, base) for each in text.split(";") if each.strip())


def refuse_unknown(text: str, base: FaultModel | None) -> None:
    """Refuse what is wrong with faults whatever the plan will be. Raises `InvalidInput`."""
    for each in filter(None, (part.strip() for part in text.split(";"))):
        _parted(each, base)


def _parted(text: str, base: FaultModel | None) -> tuple[str, str, str]:
    """The step of a fault, its cause, and its exception or nothing."""
    named, equals, rest = text.rpartition("=")
    cause, _, exception = rest.partition("@")
    named, cause = named.strip(), cause.strip()
    if not equals or not named or not cause:
        raise _refused(f"'{text}' is no fault", "write STEP=CAUSE: 3=not_gripped, or pick#2=arm_offset")
    if base is None:
        raise _refused("the domain has no fault base", "write a faults.yaml beside it")
    if cause not in base.causes:
        raise InvalidInput([_unknown(cause, base, re.split(r"[#(]", named)[0].strip())])
    return named, cause, exception


def _settled(text: str, ready: Ready, base: FaultModel | None) -> str:
    named, cause, exception = _parted(text, base)
    assert base is not None
    action, _, time = named.partition("#")
    steps = [step.operator for step in sorted(ready.plan.steps, key=lambda s: (ready.starts[s.id], s.id))]
    found = _step(action.strip(), ready, steps)
    ways = [way for step in found for way in possible(base, step, cause)]
    if not ways:
        where = sorted(
            {str(e.operator) for e in base.exceptions.values() if cause in e.counts and e.operator}
        )
        raise _refused(f"{cause} does not show at {action.strip()}", f"it shows at: {', '.join(where)}")
    instance = str(found[0]) if is_count(action.strip()) else action.strip()
    return f"{instance}{'#' + time if time else ''}={cause}{'@' + exception if exception else ''}"


def _unknown(cause: str, base: FaultModel, operator: str) -> Diagnostic:
    """No such cause: the nearest name, or those that can show at steps of the operator, if one is named."""
    found = unknown_name("cause", cause, base.causes, WHERE)
    shown = {
        name
        for each in base.exceptions.values()
        if each.operator and each.operator.name == operator
        for name in each.counts
    }
    if nearest(cause, base.causes) or not shown:
        return found
    return replace(found, hint=f"at {operator}: {', '.join(sorted(shown))}")


def _step(action: str, ready: Ready, steps: list[Function]) -> list[Function]:
    """The steps that a fault names: one by its number or as it is written, or all of an operator."""
    if is_count(action):
        found = [step.operator for step in ready.plan.steps if int(step.id) == int(action)]
        hint = f"the plan has steps 1 to {len(steps)}"
    else:
        plain = action.replace(" ", "")
        found = [step for step in steps if plain in (step.name, str(step).replace(" ", ""))]
        hint = nearest(action, list(dict.fromkeys(step.name for step in steps))) or _some(steps)
    if not found:
        raise _refused(f"the plan has no step {action}", hint)
    return found


def _some(steps: Iterable[Function]) -> str:
    names = list(dict.fromkeys(step.name for step in steps))
    return f"it has: {', '.join(names)}"


def _refused(message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(WHERE, "K421", message, hint)])
