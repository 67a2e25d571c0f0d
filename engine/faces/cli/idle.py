"""Options that would change nothing are refused."""

from collections.abc import Mapping

import typer


class IdleOption(typer.BadParameter):
    """An option that would change nothing."""


def refuse_idle(options: Mapping[str, object], why: str) -> None:
    """Refuse the first of the options that is given, because it would change nothing. Raises `IdleOption`."""
    for name, value in options.items():
        if value:
            raise IdleOption(f"{name} has no effect {why}")
