"""Files beside or instead of the printed answer: `--output`, its form, and pictures."""

import os
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeVar

from typer import Option

from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle

AnyForm = TypeVar("AnyForm", bound=StrEnum)

Output = Annotated[
    Path | None,
    Option(
        "--output",
        "-o",
        metavar="FILE",
        help="write the answer to this file, too; its ending says how, as .json",
    ),
]


def answer_form(output: Path | None, given: AnyForm | None, text: AnyForm) -> AnyForm:
    """How the answer is written: as `--format` says, else as the name of the file ends, else as
    text.

    Raises `typer.BadParameter` if there is a file and neither says a form that files have.
    """
    if given is not None:
        refuse_idle(
            {"--output": output} if given is text else {}, "on text: name another --format, or none"
        )
        return given
    if output is None:
        return text
    forms = {
        f".{known_form.value}": known_form for known_form in type(text) if known_form is not text
    }
    form_by_suffix = forms.get(output.suffix.lower())
    if form_by_suffix is None:
        raise make_misfit(f"--output: the name of the file must end in one of {', '.join(forms)}")
    return form_by_suffix


def save_text(output: Path, text: str) -> None:
    """Write a file whole or not at all. Raises `OSError`, and then leaves nothing behind."""
    file = output.resolve()  # a link stays a link
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        beside.write_text(text, "utf-8", newline="\n")
        beside.replace(file)
    except OSError:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise


def write_picture(path: Path | None, made: Callable[[], bytes]) -> None:
    """Write what is made into a file, if there is to be one.

    Raises `InvalidInput` for a file that cannot be written.
    """
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if path is None:
        return
    try:
        path.write_bytes(made())
    except OSError as error:
        message = f"it cannot be written: {error.strerror}"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K702", message, "is its folder there?")]
        ) from None
