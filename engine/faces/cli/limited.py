"""Every verb takes limits of time and memory, which bound the whole command."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any

from engine.faces.cli.options import MemoryLimit, TimeLimit
from engine.faces.cli.slow import shown
from engine.faces.cli.watchdog import watching


def limited(verb: Callable[..., None], name: str) -> Callable[..., None]:
    """The verb with limits of time and memory for the whole command: as options of its own, or added here.

    If it is slow, it tells what it does, by its `name`.
    """
    signature = inspect.signature(verb)
    kinds = {"time_limit": TimeLimit, "memory_limit": MemoryLimit}
    added = {name: kind for name, kind in kinds.items() if name not in signature.parameters}

    @wraps(verb)
    def run(*arguments: Any, **options: Any) -> None:
        with watching(options.get("time_limit"), options.get("memory_limit")), shown(name):
            verb(*arguments, **{name: value for name, value in options.items() if name not in added})

    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in added.items()
    ]
    run.__annotations__ = {**verb.__annotations__, **added}
    run.__signature__ = signature.replace(parameters=[*signature.parameters.values(), *more])  # type: ignore[attr-defined]
    return run
