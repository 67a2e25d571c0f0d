"""The path of the default store: where journals are kept if no place is named."""

import os
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source


def default_store() -> str:
    """The journal of those who name none: in the folder for the state of programs, which only its
    owner can enter.

    Raises `InvalidInput` if that is closed.
    """
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    folder = state / "cellwright"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if folder.stat().st_uid == os.getuid():
            folder.chmod(0o700)  # an older version has let others read it
    except OSError as error:
        said = f"no journal can be kept there: {(error.strerror or str(error)).lower()}"
        hint = "name a place for it: --store FILE, or CELLWRIGHT_STORE"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K415", said, hint)]) from None
    return str(folder / "runs.db")
