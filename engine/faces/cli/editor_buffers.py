"""The command line for an editor: it reads the texts in its buffers in place of saved files."""

import json
import sys


def run_with_buffers() -> None:
    """Run a command with the texts of an editor in place of files.

    Both come as JSON from standard input.
    """
    from cellwright.engine.faces.cli import main as command_line
    from cellwright.kb.files import read_unsaved

    request = json.loads(sys.stdin.buffer.read())
    sys.argv = ["cellwright", *request["arguments"]]
    with read_unsaved(request["unsaved"]):
        command_line()
