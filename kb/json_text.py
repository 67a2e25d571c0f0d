"""Parses JSON texts from anywhere: what cannot be read is a `ValueError`, whatever the reason."""

import json
import re
from typing import Any

HALF_SURROGATE = re.compile(
    r"\\u[dD][89a-fA-F]"
)  # perhaps half of a pair of surrogates, which is no character


def parse_json(text: str | bytes) -> Any:
    """What a JSON text says.

    Raises `ValueError`, also where it is nested too deeply, a character is not whole, or it is no
    text.
    """
    try:
        value = json.loads(text)
        if HALF_SURROGATE.search(
            text if isinstance(text, str) else text.decode("utf-8", "replace")
        ):
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except TypeError:
        raise ValueError("not a text") from None
    return value
