"""The methods of dataclasses, compiled once and kept beside Python's own bytecode.

A dataclass writes its methods as source and compiles them whenever its module is imported: nine tenths of what it costs to make
the class, and a third of the whole time of a small task. Here `dataclasses` does all that it always does, with the same
source, but compiles only what no earlier run has compiled. Only a process that is nothing but a command does so: where
`cellwright` is a library, the standard library is left as it is.
"""

import builtins
import dataclasses
import marshal
import os
import sys
from contextlib import suppress
from pathlib import Path
from types import CodeType
from typing import Any

MOST = 20_000  # sources; beyond it only those of the last run are kept


class Methods:
    """Compiled sources, from a file and for that file. A file of another Python, or a damaged one, is as good as none."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._known = _read(file)
        self._fresh: dict[str, CodeType] = {}

    def run(self, source: str, *spaces: Any) -> None:
        """Do what `exec` does with a source."""
        code = self._known.get(source) or self._fresh.get(source)
        if code is None:
            code = self._fresh[source] = compile(source, "<string>", "exec")
        builtins.exec(code, *spaces)

    def keep(self) -> None:
        """Write what was compiled, where Python may write its bytecode. If that fails, the next run compiles again."""
        if not self._fresh or sys.dont_write_bytecode:
            return
        kept = {**self._known, **self._fresh} if len(self._known) < MOST else self._fresh
        other = self.file.with_name(f"{self.file.name}.{os.getpid()}")
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            other.write_bytes(marshal.dumps((sys.version, kept)))
            other.replace(self.file)
        except OSError:
            with suppress(OSError):
                other.unlink()


def _read(file: Path) -> dict[str, CodeType]:
    try:
        version, kept = marshal.loads(file.read_bytes())
    except (OSError, EOFError, ValueError, TypeError):
        return {}
    return kept if version == sys.version else {}


def kept_methods() -> Methods | None:
    """From now on dataclasses of this process are made with kept methods. None if there is no place for bytecode."""
    cached = __spec__.cached if __spec__ else None
    if cached is None:
        return None
    methods = Methods(Path(cached).with_suffix(".methods"))
    vars(dataclasses)["exec"] = methods.run  # where the standard library calls the built-in one
    return methods
