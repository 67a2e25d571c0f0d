"""The key of a site, with which the heads of its journals are sealed."""

import os
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

KEY_VARIABLE = "CELLWRIGHT_KEY"
MIN_KEY_BYTES = 16


def site_key() -> bytes | None:
    """What the file holds that `CELLWRIGHT_KEY` names; None if it names none.

    Raises `InvalidInput` if the file cannot be read, or holds less than 16 bytes.
    """
    name = os.environ.get(KEY_VARIABLE)
    if not name:
        return None
    hint = "make one: head -c 32 /dev/urandom > FILE; chmod 600 FILE"
    try:
        key = Path(name).read_bytes()
    except OSError as error:
        said = f"the key cannot be read: {(error.strerror or str(error)).lower()}"
        raise InvalidInput([Diagnostic(Source(name), "K416", said, hint)]) from None
    if len(key) < MIN_KEY_BYTES:
        said = f"a key has at least {MIN_KEY_BYTES} bytes, and this one has {len(key)}"
        raise InvalidInput([Diagnostic(Source(name), "K416", said, hint)])
    return key
