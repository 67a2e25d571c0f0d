"""The verb `lsp`: the language server for editors."""

from typing import Annotated

from typer import Option

from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

LSP_PACKAGES = ("pygls", "lsprotocol")
Stdio = Annotated[
    bool,
    Option("--stdio", help="speak over standard input and output, as always", show_default=False),
]


def serve_lsp(_stdio: Stdio = True) -> None:
    """Serve an editor that writes domains: errors while typing, completion, hover, rename.

    Editors start it (docs/editor.md).
    """
    give_answer(_serve_lsp, AnswerForm.TEXT)


def _serve_lsp() -> VerbAnswer:
    from importlib.util import find_spec

    if missing := [
        package_name for package_name in LSP_PACKAGES if find_spec(package_name) is None
    ]:
        message = f"the language server needs {', '.join(missing)}"
        hint = "pip install 'cellwright[lsp]'"
        raise InvalidInput([Diagnostic(Source("cellwright lsp"), "K414", message, hint)])
    from cellwright.engine.faces.lsp.language_server import serve_editor

    serve_editor()
    return VerbAnswer("ok")
