"""`--output`: the answer of a command in a file, while its text is printed."""

import os
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeVar

from cellwright.engine.faces.cli.declared import Option, misfit
from cellwright.engine.faces.cli.idle import refuse_idle

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


def form_of(output: Path | None, given: AnyForm | None, text: AnyForm) -> AnyForm:
    """How the answer is written: as `--format` says, else as the name of the file ends, else as text.

    Raises `BadParameter` if there is a file and neither says a form that files have.
    """
    if given is not None:
        refuse_idle({"--output": output} if given is text else {}, "on text: name another --format, or none")
        return given
    if output is None:
        return text
    forms = {f".{each.value}": each for each in type(text) if each is not text}
    found = forms.get(output.suffix.lower())
    if found is None:
        raise misfit(f"--output: the name of the file must end in one of {', '.join(forms)}")
    return found


def save(output: Path, text: str) -> None:
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
