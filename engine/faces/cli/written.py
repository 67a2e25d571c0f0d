"""Pictures that commands write beside their answer."""

from collections.abc import Callable
from pathlib import Path


def write(path: Path | None, made: Callable[[], bytes]) -> None:
    """Write what is made into a file, if there is to be one. Raises `InvalidInput` for a file that cannot be written."""
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if path is None:
        return
    try:
        path.write_bytes(made())
    except OSError as error:
        told = f"it cannot be written: {error.strerror}"
        raise InvalidInput([Diagnostic(Source(str(path)), "K702", told, "is its folder there?")]) from None
