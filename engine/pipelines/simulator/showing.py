"""By which exceptions causes can show, and the steps in commands."""

from collections.abc import Iterator

from cellwright.kb.asp import ground_term
from cellwright.kb.model.faults import FaultModel, Interruption
from cellwright.kb.terms import Function, match


def exceptions(model: FaultModel, step: Function, cause: str = "", name: str = "") -> Iterator[Interruption]:
    """The exceptions that a step can have, for a cause if it is given."""
    for each in model.exceptions.values():
        fits = each.operator is not None and match(each.operator, step, {}) is not None
        if fits and (not cause or cause in each.counts) and name in ("", each.name):
            yield each


def possible(model: FaultModel, step: Function, cause: str) -> tuple[str, ...]:
    """The exceptions by which a cause can show at a step."""
    return tuple(each.name for each in exceptions(model, step, cause))


_read: dict[str, Function] = {}


def instance(text: str) -> Function:
    """The step in a command."""
    if text not in _read:
        if len(_read) > 1 << 14:
            _read.clear()
        found = ground_term(text)
        assert isinstance(found, Function)
        _read[text] = found
    return _read[text]
