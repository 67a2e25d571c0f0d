"""Declarations of arguments and options in the words of typer, but without loading typer.

To load typer takes a fifth of the time of a small task, and a plain command line is read without it
(`plain_lines`). For help, mistakes and all else `typed` hands typer what is declared here.
"""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

WRONG = "K407"  # the code of a wrong command line

if TYPE_CHECKING:
    from typer import Argument as Argument
    from typer import Option as Option
else:

    def Option(*names: str, **settings: Any) -> "DeclaredOption":
        """What `typer.Option` takes."""
        return DeclaredOption("Option", names, settings)

    def Argument(**settings: Any) -> "DeclaredOption":
        """What `typer.Argument` takes."""
        return DeclaredOption("Argument", (), settings)


class DeclaredOption:
    """An argument or an option, with its names and settings."""

    __slots__ = ("kind", "names", "settings")

    def __init__(self, kind: str, names: tuple[str, ...], settings: dict[str, Any]) -> None:
        self.kind, self.names, self.settings = kind, names, settings


def declaration_of(annotation: Any) -> DeclaredOption | None:
    """What an annotation declares."""
    declaration = getattr(annotation, "__metadata__", (None,))[0]
    return declaration if isinstance(declaration, DeclaredOption) else None


def typer_annotation(annotation: Any) -> Any:
    """The annotation as typer takes it."""
    if (declaration := declaration_of(annotation)) is None:
        return annotation
    import typer

    return Annotated[
        annotation.__origin__,
        getattr(typer, declaration.kind)(*declaration.names, **declaration.settings),
    ]


def make_misfit(message: str, code: str = WRONG, param_hint: str | None = None) -> Exception:
    """A wrong command line, to be raised: typer tells it with the verb that it belongs to.

    `code` is told to programs.
    """
    import typer

    wrong = typer.BadParameter(message, param_hint=param_hint)
    vars(wrong)["code"] = code
    return wrong


def is_misfit(error: Exception) -> bool:
    """Whether an error is a wrong command line."""
    typer = sys.modules.get("typer")
    return typer is not None and isinstance(error, typer.BadParameter)


IDLE = "K408"  # the code of an option that would change nothing


def refuse_idle(options: Mapping[str, object], why: str) -> None:
    """Refuse the first of the options that is given, because it would change nothing: raises a
    `misfit`.
    """
    for name, value in options.items():
        if value:
            raise make_misfit(f"{name} has no effect {why}", IDLE)
