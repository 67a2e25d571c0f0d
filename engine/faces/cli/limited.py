"""Every verb takes limits of time and memory, which bound the whole command."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

from cellwright.engine.faces.cli.declared import typed
from cellwright.engine.faces.cli.options import MemoryLimit, TimeLimit
from cellwright.engine.faces.cli.slow import shown
from cellwright.engine.faces.cli.watchdog import watching

LIMITS = {"time_limit": TimeLimit, "memory_limit": MemoryLimit}


def parameters(verb: Callable[..., None]) -> Mapping[str, inspect.Parameter]:
    """What a verb takes by name: its own parameters, and those limits that are not among them."""
    own = inspect.signature(verb).parameters
    added = {
        name: inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in LIMITS.items()
        if name not in own
    }
    return {**own, **added}


def run_limited(verb: Callable[..., None], name: str, options: Mapping[str, Any]) -> None:
    """Call a verb with the limits that are among its options. If it is slow, it tells what it does, by its `name`."""
    with watching(options.get("time_limit"), options.get("memory_limit")), shown(name):
        taken = verb.__annotations__
        verb(**{name: value for name, value in options.items() if name in taken or name not in LIMITS})


def limited(verb: Callable[..., None], name: str) -> Callable[..., None]:
    """The verb as typer takes it, with its limits."""
    taken = [each.replace(annotation=typed(each.annotation)) for each in parameters(verb).values()]

    @wraps(verb)
    def run(**options: Any) -> None:
        run_limited(verb, name, options)

    run.__annotations__ = {each.name: each.annotation for each in taken}
    run.__signature__ = inspect.signature(verb).replace(parameters=taken)  # type: ignore[attr-defined]
    return run
