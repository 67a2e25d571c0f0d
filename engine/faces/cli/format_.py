"""`cellwright format`: files in their usual form."""

from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.exits import BAD_INPUT, FINDINGS
from cellwright.engine.faces.cli.options import Format

Files = Annotated[
    list[Path],
    Argument(metavar="FILE...", help="files, or folders of which every .yaml and .lp file is taken"),
]
Check = Annotated[bool, Option("--check", help="write nothing; exit with 1 if a file has another form")]


def format_files(files: Files, check: Check = False, format: Format = Form.TEXT) -> None:
    """Give FILEs their usual indentation and spaces. Comments and meaning stay. A broken file is left as it is."""
    give(lambda: _formatted(files, check), format)


def _formatted(files: list[Path], check: bool) -> Answer:
    from rich.text import Text

    from cellwright.engine.authoring.layout import arrange

    made = arrange(files, write=not check)
    code = BAD_INPUT if made.findings else FINDINGS if check and made.changed else 0
    verb = "would change" if check else "changed"
    left = made.looked_at - len(made.changed) - made.broken
    lines = [f"{verb} {each}" for each in made.changed]
    lines.append(
        f"{len(made.changed)} {verb}, {left} already in form"
        + (f", {made.broken} broken" if made.broken else "")
    )
    content = {"changed": list(made.changed), "files": made.looked_at}
    status = "bad input" if code == BAD_INPUT else "changes" if made.changed else "ok"
    return Answer(status, content, lambda: Text("\n".join(lines)), code, made.findings)
