"""What pages show: files that a reader writes, command lines, what they print, and pictures that
they make.

A page may tell a story: its files and command lines are gone through in order, in one folder. A
fenced block that begins with a comment `# path` is a file; with `# path, in addition`, lines at the
end of one. A fenced block right below a command line is what it prints; a line `...` in it stands
for any number of lines. `cellwright ... > file` writes what it prints into a file.
"""

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

TOP = Path(__file__).parents[2]
PATHS = [TOP / "README.md", *sorted(TOP.glob("docs/*.md"))]
DECISIONS = sorted(TOP.glob("docs/decisions/*.md"))
GAP = "..."
LINE = r'cellwright (?:[^"\n]|"[^"]*")*'
PART = re.compile(
    rf"^    (?P<line>{LINE})\n(?:\n*```\n(?P<shown>.*?)^```$)?"
    r"|^```\w*\n[#%] (?P<path>[\w./-]+\.\w+)(?P<added>, in addition)?\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Written:
    """A file that the reader writes, or lines at its end."""

    path: str
    text: str
    added: bool


@dataclass(frozen=True, slots=True)
class Run:
    """A command line; what is shown below it, and where in the page, if anything is."""

    line: str
    shown: str | None
    start: int
    end: int


def parts(page: str) -> Iterator[Written | Run]:
    """The files and command lines of a page, in order."""
    for found in PART.finditer(page):
        if found["path"]:
            yield Written(found["path"], found["text"], bool(found["added"]))
        else:
            yield Run(" ".join(found["line"].split()), found["shown"], *found.span("shown"))


def run(line: str) -> Result:
    """Runs a command line in this process, 120 columns wide, with the runs that it keeps in the
    folder where it is.
    """
    words, _, file = line.partition(" > ")
    result = CliRunner().invoke(
        app, shlex.split(words)[1:], env={"COLUMNS": "120", "XDG_STATE_HOME": "state"}
    )
    if file:
        Path(file).write_text(result.stdout, "utf-8")
    return result


def printed(result: Result) -> str:
    """What a command has printed, without blanks at ends of lines."""
    return "".join(f"{line.rstrip()}\n" for line in result.output.splitlines())


def fits(shown: str, text: str) -> bool:
    """Whether a text is what is shown, where `...` stands for any lines."""
    pattern = "".join(
        "(?:.*\n)*?" if line == GAP else re.escape(f"{line}\n") for line in shown.splitlines()
    )
    return re.fullmatch(pattern, text) is not None


def renewed(shown: str, text: str) -> str:
    """What is to be shown of a text: all of it, or as many lines before and behind a gap as
    were shown before.
    """
    lines, new = shown.splitlines(), text.splitlines()
    if fits(shown, text) or lines.count(GAP) > 1:
        return shown
    if GAP in lines:
        ahead = lines.index(GAP)
        behind = len(lines) - ahead - 1
        new = [*new[:ahead], GAP, *new[len(new) - behind :]]
    return "".join(f"{line}\n" for line in new)


def assert_shown(path: Path, results: Mapping[Run, Result], update: bool) -> None:
    """Each command has printed what the page shows; or, to be updated, the page shows it from
    now on.
    """
    if update and not os.environ.get("CI"):
        write(
            path, ((each, renewed(each.shown or "", printed(ran))) for each, ran in results.items())
        )
    lines = {each.line for each in results}
    now = [
        each
        for each in parts(path.read_text("utf-8"))
        if isinstance(each, Run) and each.shown is not None
    ]
    texts = [printed(ran) for each, ran in results.items() if each.shown is not None]
    for each, text in zip((each for each in now if each.line in lines), texts, strict=True):
        if not fits(each.shown or "", text):
            pytest.fail(f"{path.name}: {each.line}\nshows\n{each.shown}\nand prints\n{text}")


def write(path: Path, shown: Iterable[tuple[Run, str]]) -> None:
    """The page with other texts below command lines."""
    page = path.read_text("utf-8")
    for each, text in sorted(shown, key=lambda item: -item[0].start):
        if each.shown is not None:
            start, end = each.start, each.end
            if page[start:end] != each.shown:  # an earlier test has changed what stands above
                start = page.index(each.shown)
                end = start + len(each.shown)
            page = page[:start] + text + page[end:]
    path.write_text(page, "utf-8")
