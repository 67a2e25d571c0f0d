"""Faults that are ordered for a simulated cell, and how they are written."""

from dataclasses import dataclass

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import is_count


@dataclass(frozen=True, slots=True)
class Injection:
    """A fault that appears when a step is carried out: which step, the how-manieth time, and its cause.

    `action` is the step as an instance, or the name of its operator for any step of it. `exception` is how the step fails;
    empty for the first one of the base that the cause can have there.
    """

    action: str
    cause: str
    time: int = 1
    exception: str = ""


def injection(text: str) -> Injection:
    """An injection in the form STEP[#TIME]=CAUSE[@EXCEPTION]. Raises `InvalidInput`."""
    step, _, rest = text.rpartition("=")
    cause, _, exception = rest.partition("@")
    action, _, which = step.partition("#")
    if not action or not cause or (which and not is_count(which)):
        hint = "write STEP=CAUSE: pick(probe_1, slot(drawer, 1))=not_gripped, or pick#2=arm_offset"
        raise InvalidInput([Diagnostic(Source("--fault"), "K107", f"'{text}' is no fault", hint)])
    return Injection(action.strip(), cause.strip(), int(which or 1), exception.strip())
