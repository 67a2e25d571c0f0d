"""Cache of what Python compiles at import (dataclasses, patterns), kept beside its bytecode.

A dataclass writes its methods as source and compiles them: nine tenths of what it costs to make the
class, and a third of the whole time of a small task. Regular expressions are compiled, too. Here
`dataclasses` and `re` do all that they always do, but compile only what no earlier run has
compiled. Only a process that is nothing but a command does so: where `cellwright` is a library, the
standard library is left as it is.
"""

import builtins
import dataclasses
import marshal
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

MOST = 20_000  # sources and expressions; beyond it only those of the last run are kept
OPTIMIZED = 0x1  # a flag of the code of functions, which those of modules and classes do not have
BETWEEN = (__name__, "re", "re._compiler", "functools")  # who asks, and who compiles

Source = str | tuple[str | bytes, int]  # of methods, or an expression and its flags
Compiled = CodeType | tuple[Any, ...]  # methods, or what the matcher takes


class KeptCode:
    """What was compiled, from a file and for that file.

    A file of another Python, or a damaged one, is as good as none.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._known = _read(file)
        self._fresh: dict[Source, Compiled] = {}

    def run(self, source: str, *spaces: Any) -> None:
        """Do what `exec` does with a source."""
        code: Any = self._known.get(source) or self._fresh.get(source)
        if code is None:
            code = self._fresh[source] = compile(source, "<string>", "exec")
        builtins.exec(code, *spaces)

    def pattern(
        self, compiler: Callable[..., Any], noting: "Noting", expression: Any, flags: int = 0
    ) -> Any:
        """Do what the `compiler` of `re` does.

        Expressions in functions are not kept: there may be ever more of them.
        """
        known: Any = (
            self._known.get((expression, flags)) if isinstance(expression, str | bytes) else None
        )
        if known is not None:
            return noting.matcher.compile(expression, *known)
        made = compiler(expression, flags)
        if isinstance(expression, str | bytes) and _at_import():
            _, kinds, steps, *groups = noting.noted
            self._fresh[expression, flags] = (kinds, [int(each) for each in steps], *groups)
        return made

    def keep(self) -> None:
        """Write what was compiled, where Python may write its bytecode.

        If that fails, the next run compiles again.
        """
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


class Noting:
    """The matcher of `re`, which notes what it was last made of."""

    def __init__(self, matcher: Any) -> None:
        self.matcher = matcher
        self.noted: tuple[Any, ...] = ()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.matcher, name)

    def compile(self, *parts: Any) -> Any:
        """Do what the matcher does."""
        self.noted = parts
        return self.matcher.compile(*parts)


def _at_import() -> bool:
    """Whether the code that compiles an expression is that of a module or of a class."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__") in BETWEEN:
        frame = frame.f_back
    return frame is not None and not frame.f_code.co_flags & OPTIMIZED


def _read(file: Path) -> dict[Source, Compiled]:
    try:
        version, kept = marshal.loads(file.read_bytes())
    except (OSError, EOFError, ValueError, TypeError):
        return {}
    return kept if version == sys.version else {}


def kept_code() -> KeptCode | None:
    """From now on this process makes dataclasses and expressions with kept code.

    None if there is no place for bytecode.
    """
    cached = __spec__.cached if __spec__ else None
    if cached is None:
        return None
    code = KeptCode(Path(cached).with_suffix(".kept"))
    vars(dataclasses)["exec"] = code.run  # where the standard library calls the built-in one
    keep_patterns(code)
    return code


def keep_patterns(code: KeptCode) -> None:
    """From now on this process makes expressions with kept code, if its `re` is the one that is
    known here.
    """
    compiler: Any = vars(re).get("_compiler")
    if not hasattr(compiler, "_sre") or not hasattr(compiler, "compile"):
        return
    noting, plain = Noting(compiler._sre), compiler.compile
    vars(compiler)["_sre"] = noting
    vars(compiler)["compile"] = lambda expression, flags=0: code.pattern(
        plain, noting, expression, flags
    )
