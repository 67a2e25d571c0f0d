"""`cellwright lsp`: the language server."""

from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Option

EXTRA = ("pygls", "lsprotocol")
Stdio = Annotated[
    bool, Option("--stdio", help="speak over standard input and output, as always", show_default=False)
]


def lsp(_stdio: Stdio = True) -> None:
    """Serve an editor that writes domains: errors while typing, completion, hover, rename. Editors start it (docs/editor.md)."""
    give(_served, Form.TEXT)


def _served() -> Answer:
    from importlib.util import find_spec

    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

    if missing := [each for each in EXTRA if find_spec(each) is None]:
        said = f"the language server needs {', '.join(missing)}"
        hint = "pip install 'cellwright[lsp]'"
        raise InvalidInput([Diagnostic(Source("cellwright lsp"), "K414", said, hint)])
    from cellwright.engine.faces.lsp.server import serve

    serve()
    return Answer("ok")
