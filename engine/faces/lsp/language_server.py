"""The language server: which function answers which request of an editor."""

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams, JsonRpcRequestCancelled
from pygls.lsp.server import LanguageServer

from cellwright.engine.faces.lsp import code_lenses, request_answers
from cellwright.engine.faces.lsp.live_diagnostics import LiveDiagnostics
from cellwright.engine.faces.lsp.open_files import OpenFiles, path_of

SERVER_NAME = "cellwright"
COMPLETION_TRIGGERS = ["(", ",", " ", ":", "{", "["]
REQUEST_ANSWERS: dict[str, tuple[Callable[[OpenFiles, Any], Any], Any]] = {
    types.TEXT_DOCUMENT_HOVER: (request_answers.hover_text, None),
    types.TEXT_DOCUMENT_COMPLETION: (
        request_answers.complete_name,
        types.CompletionOptions(trigger_characters=COMPLETION_TRIGGERS),
    ),
    types.TEXT_DOCUMENT_DEFINITION: (request_answers.find_definitions, None),
    types.TEXT_DOCUMENT_REFERENCES: (request_answers.find_references, None),
    types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT: (request_answers.find_highlights, None),
    types.TEXT_DOCUMENT_DOCUMENT_SYMBOL: (request_answers.outline_symbols, None),
    types.WORKSPACE_SYMBOL: (request_answers.workspace_symbols, None),
    types.TEXT_DOCUMENT_PREPARE_RENAME: (request_answers.prepare_rename, None),
    types.TEXT_DOCUMENT_RENAME: (
        request_answers.rename_edit,
        types.RenameOptions(prepare_provider=True),
    ),
    types.TEXT_DOCUMENT_CODE_ACTION: (
        request_answers.code_actions,
        types.CodeActionOptions(code_action_kinds=[types.CodeActionKind.QuickFix]),
    ),
    types.TEXT_DOCUMENT_FORMATTING: (request_answers.format_text, None),
    types.TEXT_DOCUMENT_CODE_LENS: (
        code_lenses.code_lenses,
        types.CodeLensOptions(resolve_provider=False),
    ),
}
"""For each request: what answers it from the texts, and what the editor is told about it."""


def serve_editor() -> None:
    """Answer an editor over standard input and output until it ends the session."""
    entry, answer = _own_streams()
    logging.getLogger("pygls.protocol.json_rpc").addFilter(_is_failure)
    server, findings = make_server()
    try:
        server.start_io(entry, answer)
    finally:
        findings.stop()


def _is_failure(record: logging.LogRecord) -> bool:
    """Whether a message of the log is about a failure.

    A request that is refused, with the reason, is none.
    """
    return not (
        record.exc_info
        and isinstance(record.exc_info[1], JsonRpcInvalidParams | JsonRpcRequestCancelled)
    )


def make_server() -> tuple[LanguageServer, LiveDiagnostics]:
    """A server, and what finds errors for it."""
    server = LanguageServer(
        SERVER_NAME,
        _package_version(),
        text_document_sync_kind=types.TextDocumentSyncKind.Incremental,
    )
    desk = OpenFiles()
    findings = LiveDiagnostics(desk, server.text_document_publish_diagnostics)
    _hear_editor(server, desk, findings)
    for method, (answer, options) in REQUEST_ANSWERS.items():
        server.feature(method, options)(_handler_of(answer, desk))
    for command in code_lenses.LENS_VERBS:
        server.command(command)(_command_handler(server, desk, command))
    return server, findings


def _handler_of(answer: Callable[[OpenFiles, Any], Any], desk: OpenFiles) -> Callable[[Any], Any]:
    def answered(asked: Any) -> Any:
        return answer(desk, asked)

    return answered


def _command_handler(server: LanguageServer, desk: OpenFiles, command: str) -> Callable[..., Any]:
    async def ordered(uri: str) -> dict[str, Any]:
        return await code_lenses.run_lens_command(server, desk, command, uri)

    return ordered


def _hear_editor(server: LanguageServer, desk: OpenFiles, findings: LiveDiagnostics) -> None:
    """Take notice of what the editor opens, changes, saves and closes."""

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(asked: types.DidOpenTextDocumentParams) -> None:
        findings.edited(desk.open(asked.text_document))

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(asked: types.DidChangeTextDocumentParams) -> None:
        findings.edited(desk.change(asked))

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(asked: types.DidSaveTextDocumentParams) -> None:
        findings.edited(path_of(asked.text_document.uri))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(asked: types.DidCloseTextDocumentParams) -> None:
        findings.closed(desk.close(asked.text_document.uri))

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def moved(asked: types.DidChangeWatchedFilesParams) -> None:
        for path in {desk.domain(path_of(change.uri)) for change in asked.changes} - {""}:
            findings.edited(path)

    @server.feature(types.SHUTDOWN)
    async def ended(_: Any) -> None:
        findings.stop()
        await asyncio.sleep(0)


def _own_streams() -> tuple[Any, Any]:
    """The streams of the protocol, moved away so that nothing else writes to them: what is
    printed goes to standard error.
    """
    entry, answer = os.dup(0), os.dup(1)
    silence = os.open(os.devnull, os.O_RDONLY)
    os.dup2(silence, 0)
    os.close(silence)
    os.dup2(2, 1)
    with contextlib.suppress(ValueError, OSError):
        sys.stdout.flush()
    return os.fdopen(entry, "rb"), os.fdopen(answer, "wb")


def _package_version() -> str:
    try:
        return version(SERVER_NAME)
    except PackageNotFoundError:
        return "0"
