"""Start-up time of every command: from the call to its page of help, in seconds of the processor.

    python benchmarks/start.py [--runs N] [--json FILE]

Each command runs N times in a process of its own; the least time counts, because other work on the
machine makes it longer and never shorter. Exits with 1 if `cellwright --help` takes 0.3 s or more,
or another command more than twice that.
"""

import argparse
import json
import resource
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import typer

from cellwright.engine.faces.cli import app

HELP_S = 0.3
COMMAND = [sys.executable, "-m", "cellwright.engine.faces.cli"]


def commands(group: Any, before: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every command, with those of groups; first the program itself."""
    yield before
    for name in sorted(getattr(group, "commands", {})):
        yield from commands(group.commands[name], (*before, name))


def started(words: Sequence[str], runs: int) -> float:
    """The least seconds of the processor in which a command has printed its help.

    Raises `CalledProcessError`.
    """
    return min(_once(words) for _ in range(runs))


def _once(words: Sequence[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*COMMAND, *words, "--help"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)


def main() -> int:
    """Print the times, the longest first; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = {
        " ".join(words): started(words, asked.runs)
        for words in commands(typer.main.get_command(app))
    }
    for name, taken in sorted(found.items(), key=lambda each: -each[1]):
        print(f"{taken:6.2f} s  cellwright {name}")
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    return int(found[""] >= HELP_S or max(found.values()) > 2 * HELP_S)


if __name__ == "__main__":
    sys.exit(main())
