"""Reads journals with suspicion: one that somebody has changed is bad input, not an internal error."""

from collections.abc import Iterator
from contextlib import contextmanager

from cellwright.kb.asp import AspError
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

STRANGE = (AspError, ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)


@contextmanager
def reading_past(store: str, run: str) -> Iterator[None]:
    """A context that reads the records of a run. Raises `InvalidInput` where they say what no run writes."""
    try:
        yield
    except STRANGE as error:
        said = f"the journal of run '{run}' says what no run writes: {type(error).__name__}: {error}"
        hint = "`cellwright store restore BACKUP --replace` puts a backup in its place"
        raise InvalidInput([Diagnostic(Source(store), "K422", said[:200], hint)]) from error
