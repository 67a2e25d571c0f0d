"""The server: which request is answered by what."""

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

from cellwright.engine.faces.lsp import answers, edits, orders
from cellwright.engine.faces.lsp.desk import Desk, path_of
from cellwright.engine.faces.lsp.findings import Findings

NAME = "cellwright"
TRIGGERS = ["(", ",", " ", ":", "{", "["]
ANSWERS: dict[str, tuple[Callable[[Desk, Any], Any], Any]] = {
    types.TEXT_DOCUMENT_HOVER: (answers.hover, None),
    types.TEXT_DOCUMENT_COMPLETION: (
        answers.completion,
        types.CompletionOptions(trigger_characters=TRIGGERS),
    ),
    types.TEXT_DOCUMENT_DEFINITION: (answers.definition, None),
    types.TEXT_DOCUMENT_REFERENCES: (answers.references, None),
    types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT: (answers.highlights, None),
    types.TEXT_DOCUMENT_DOCUMENT_SYMBOL: (answers.symbols, None),
    types.WORKSPACE_SYMBOL: (answers.workspace_symbols, None),
    types.TEXT_DOCUMENT_PREPARE_RENAME: (edits.prepare_rename, None),
    types.TEXT_DOCUMENT_RENAME: (edits.rename, types.RenameOptions(prepare_provider=True)),
    types.TEXT_DOCUMENT_CODE_ACTION: (
        edits.actions,
        types.CodeActionOptions(code_action_kinds=[types.CodeActionKind.QuickFix]),
    ),
    types.TEXT_DOCUMENT_FORMATTING: (edits.formatting, None),
    types.TEXT_DOCUMENT_CODE_LENS: (orders.lenses, types.CodeLensOptions(resolve_provider=False)),
}
"""For each request: what answers it from the texts, and what the editor is told about it."""


def serve() -> None:
    """Answer an editor over standard input and output until it ends the session."""
    entry, answer = _own_streams()
    logging.getLogger("pygls.protocol.json_rpc").addFilter(_is_failure)
    server, findings = made()
    try:
        server.start_io(entry, answer)
    finally:
        findings.stop()


def _is_failure(record: logging.LogRecord) -> bool:
    """Whether a message of the log is about a failure. A request that is refused, with the reason, is none."""
    return not (
        record.exc_info and isinstance(record.exc_info[1], JsonRpcInvalidParams | JsonRpcRequestCancelled)
    )


def made() -> tuple[LanguageServer, Findings]:
    """A server, and what finds errors for it."""
    server = LanguageServer(NAME, _version(), text_document_sync_kind=types.TextDocumentSyncKind.Incremental)
    desk = Desk()
    findings = Findings(desk, server.text_document_publish_diagnostics)
    _hear(server, desk, findings)
    for method, (answer, options) in ANSWERS.items():
        server.feature(method, options)(_bound(answer, desk))
    for command in orders.ORDERS:
        server.command(command)(_ordered(server, desk, command))
    return server, findings


def _bound(answer: Callable[[Desk, Any], Any], desk: Desk) -> Callable[[Any], Any]:
    def answered(asked: Any) -> Any:
        return answer(desk, asked)

    return answered


def _ordered(server: LanguageServer, desk: Desk, command: str) -> Callable[..., Any]:
    async def ordered(uri: str) -> dict[str, Any]:
        return await orders.carry_out(server, desk, command, uri)

    return ordered


def _hear(server: LanguageServer, desk: Desk, findings: Findings) -> None:
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
        for path in {desk.domain(path_of(each.uri)) for each in asked.changes} - {""}:
            findings.edited(path)

    @server.feature(types.SHUTDOWN)
    async def ended(_: Any) -> None:
        findings.stop()
        await asyncio.sleep(0)


def _own_streams() -> tuple[Any, Any]:
    """The streams of the protocol, moved away so that nothing else writes to them: what is printed goes to standard error."""
    entry, answer = os.dup(0), os.dup(1)
    silence = os.open(os.devnull, os.O_RDONLY)
    os.dup2(silence, 0)
    os.close(silence)
    os.dup2(2, 1)
    with contextlib.suppress(ValueError, OSError):
        sys.stdout.flush()
    return os.fdopen(entry, "rb"), os.fdopen(answer, "wb")


def _version() -> str:
    try:
        return version(NAME)
    except PackageNotFoundError:
        return "0"
