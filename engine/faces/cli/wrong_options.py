"""Makes or raises errors for wrong or useless options; typer shows them with the usage."""

from collections.abc import Mapping

import typer

WRONG = "K407"  # the code of a wrong command line
IDLE = "K408"  # the code of an option that would change nothing


def make_misfit(
    message: str, code: str = WRONG, param_hint: str | None = None
) -> typer.BadParameter:
    """A wrong command line, to be raised. `code` is told to programs."""
    wrong = typer.BadParameter(message, param_hint=param_hint)
    vars(wrong)["code"] = code
    return wrong


def refuse_idle(options: Mapping[str, object], why: str) -> None:
    """Refuse the first of the options that is given, because it would change nothing. Raises
    `typer.BadParameter`.
    """
    for name, value in options.items():
        if value:
            raise make_misfit(f"{name} has no effect {why}", IDLE)
