"""How verbs declare their arguments and options: in the words of typer, but without it.

To load typer takes a fifth of the time of a small task, and a plain command line is read without it (`plain_lines`). For help,
mistakes and all else `typed` hands typer what is declared here.
"""

import sys
from typing import TYPE_CHECKING, Annotated, Any

WRONG = "K407"  # the code of a wrong command line

if TYPE_CHECKING:
    from typer import Argument as Argument
    from typer import Option as Option
else:

    def Option(*names: str, **settings: Any) -> "Declared":
        """What `typer.Option` takes."""
        return Declared("Option", names, settings)

    def Argument(**settings: Any) -> "Declared":
        """What `typer.Argument` takes."""
        return Declared("Argument", (), settings)


class Declared:
    """An argument or an option, with its names and settings."""

    __slots__ = ("kind", "names", "settings")

    def __init__(self, kind: str, names: tuple[str, ...], settings: dict[str, Any]) -> None:
        self.kind, self.names, self.settings = kind, names, settings


def declared(annotation: Any) -> Declared | None:
    """What an annotation declares."""
    found = getattr(annotation, "__metadata__", (None,))[0]
    return found if isinstance(found, Declared) else None


def typed(annotation: Any) -> Any:
    """The annotation as typer takes it."""
    if (found := declared(annotation)) is None:
        return annotation
    import typer

    return Annotated[annotation.__origin__, getattr(typer, found.kind)(*found.names, **found.settings)]


def misfit(message: str, code: str = WRONG, param_hint: str | None = None) -> Exception:
    """A wrong command line, to be raised: typer tells it with the verb that it belongs to. `code` is told to programs."""
    import typer

    wrong = typer.BadParameter(message, param_hint=param_hint)
    vars(wrong)["code"] = code
    return wrong


def is_misfit(error: Exception) -> bool:
    """Whether an error is a wrong command line."""
    typer = sys.modules.get("typer")
    return typer is not None and isinstance(error, typer.BadParameter)
