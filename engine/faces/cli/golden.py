"""`cellwright test`: golden plans."""

import os
from typing import TYPE_CHECKING, Annotated, Any

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Option
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.options import Format, Target

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.authoring.testing.golden import GoldenComparison


def golden_plans(
    target: Target,
    update: Annotated[bool, Option("--update", help="accept the answers as they are now")] = False,
    format: Format = Form.TEXT,
) -> None:
    """Plan every problem of TARGET again and compare the answer with its golden file."""
    give(lambda: _test(target, update), format)


def _test(target: str, update: bool) -> Answer:
    from cellwright.engine.authoring.testing import golden
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if update and os.environ.get("CI"):
        hint = "run it on your machine, read the differences, and commit the golden files"
        found = Diagnostic(
            Source("--update"), "K403", "golden files are not rewritten in continuous integration", hint
        )
        raise InvalidInput([found])
    compared = list(golden.compare_all(target))
    if update:
        for each in compared:
            if each.verdict != "same":
                golden.update(each)
    content = {"updated": update, "problems": list(map(_entry, compared))}
    agreed = update or all(each.verdict == "same" for each in compared)
    return Answer(
        "same" if agreed else "different", content, lambda: _text(compared, update), 0 if agreed else FINDINGS
    )


def _entry(compared: "GoldenComparison") -> dict[str, Any]:
    return {
        "problem": compared.name,
        "verdict": compared.verdict,
        "meaning": list(compared.meaning),
        "diff": list(compared.diff),
    }


_COLOURS = {"+": "green", "-": "red", "@": "cyan"}


def _text(compared: "list[GoldenComparison]", updated: bool) -> "RenderableType":
    from rich.text import Text

    text = Text()
    for each in compared:
        said = f": {', '.join(each.meaning)}" if each.meaning else ""
        text.append(f"{each.verdict:9} {each.name}{said}\n", "" if each.verdict == "same" else "bold")
        for line in each.diff:
            text.append(f"    {line}\n", _COLOURS.get(line[0]))
    differing = sum(each.verdict != "same" for each in compared)
    if not compared:
        text.append("there are no problems to test")
    elif updated:
        text.append(f"{differing} of {len(compared)} golden files written")
    else:
        text.append(f"{len(compared) - differing} of {len(compared)} as accepted")
        text.append("; `--update` accepts the answers as they are now" if differing else "")
    return text
