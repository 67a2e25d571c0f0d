"""Values as JSON text, one value a line: the same text as `json.dumps(value, indent=1, ensure_ascii=False)`, in half the time.

That function writes indented text piece by piece in Python, and a plan of thousands of steps has hundreds of thousands of pieces.
"""

import json
from json.encoder import encode_basestring
from typing import Any


def written(value: Any, blank: str = "\n") -> str:
    """The text of a value; `blank` is a new line with the indent of the value."""
    if type(value) is str:
        return encode_basestring(value)
    if type(value) is int:
        return str(value)
    inner = blank + " "
    if isinstance(value, dict) and value and all(type(key) is str for key in value):
        pairs = [f"{encode_basestring(key)}: {written(each, inner)}" for key, each in value.items()]
        return f"{{{inner}{f',{inner}'.join(pairs)}{blank}}}"
    if isinstance(value, list | tuple) and value:
        return f"[{inner}{f',{inner}'.join([written(each, inner) for each in value])}{blank}]"
    return json.dumps(value, indent=1, ensure_ascii=False).replace("\n", blank)
