"""Options that would change nothing are refused."""

from collections.abc import Mapping

from cellwright.engine.faces.cli.declared import misfit

IDLE = "K408"  # the code of an option that would change nothing


def refuse_idle(options: Mapping[str, object], why: str) -> None:
    """Refuse the first of the options that is given, because it would change nothing: raises a `misfit`."""
    for name, value in options.items():
        if value:
            raise misfit(f"{name} has no effect {why}", IDLE)
