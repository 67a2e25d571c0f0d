"""The command line for an editor: it reads texts as the editor has them, saved or not."""

import json
import sys


def main() -> None:
    """Run a command with the texts of an editor in place of files. Both come as JSON from standard input."""
    from cellwright.engine.faces.cli import main as command_line
    from cellwright.kb.files import reading

    given = json.loads(sys.stdin.buffer.read())
    sys.argv = ["cellwright", *given["arguments"]]
    with reading(given["unsaved"]):
        command_line()
