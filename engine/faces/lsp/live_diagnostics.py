"""Diagnostics while typing: a domain is read after each edit and checked when the editor rests."""

import asyncio
import os
from collections.abc import Callable, Iterable, Mapping

from lsprotocol import types
from pygls.uris import from_fs_path

from cellwright.engine.authoring.editor_view import (
    EditorFindings,
    quick_findings,
    thorough_findings,
)
from cellwright.engine.faces.lsp.checking_process import CheckingProcess
from cellwright.engine.faces.lsp.open_files import OpenFiles, TextLines
from cellwright.kb.diagnostics import Diagnostic, Source

SOON, LATER = 0.05, 1.0  # seconds of rest before a domain is read, and before it is checked
QUICK, THOROUGH = 30.0, 120.0  # seconds that this may take
DIAGNOSTICS_PAGE = "docs/diagnostics.md"
Publish = Callable[[types.PublishDiagnosticsParams], None]


class LiveDiagnostics:
    """What is wrong in which file, and the tasks that find it out."""

    def __init__(self, desk: OpenFiles, publish: Publish) -> None:
        self.desk, self.publish = desk, publish
        self.found: dict[str, list[Diagnostic]] = {}  # by absolute path, as published
        self._helpers = (
            CheckingProcess(quick_findings, QUICK),
            CheckingProcess(thorough_findings, THOROUGH),
        )
        self._tasks: dict[tuple[str, bool], asyncio.Task[None]] = {}
        self._turns = asyncio.Lock(), asyncio.Lock()
        self._edits: dict[str, int] = {}

    def edited(self, path: str) -> None:
        """Look at the domain of a file again."""
        domain = self.desk.domain(path) or path
        self._edits[domain] = self._edits.get(domain, 0) + 1
        for whole in (False, True):
            if (before := self._tasks.get((domain, whole))) is not None:
                before.cancel()
            self._tasks[domain, whole] = asyncio.ensure_future(self._look(domain, whole))

    async def _look(self, domain: str, whole: bool) -> None:
        await asyncio.sleep(LATER if whole else SOON)
        asked = self._edits[domain]
        await asyncio.shield(asyncio.ensure_future(self._asked(domain, whole, asked)))

    async def _asked(self, domain: str, whole: bool, asked: int) -> None:
        """Ask a helper, and show what it finds unless the domain was edited meanwhile."""
        async with self._turns[whole]:
            if asked != self._edits[domain]:
                return
            edited = tuple(
                text_path
                for text_path in self.desk.texts
                if (self.desk.domain(text_path) or text_path) == domain
            )
            seen = await self._helpers[whole].ask(domain, edited, self.desk.texts)
        if seen is not None and asked == self._edits[domain]:
            self.show(domain, seen, edited)

    def show(self, domain: str, seen: EditorFindings, edited: Iterable[str]) -> None:
        """Publish what was found in a domain."""
        before = self.desk.seen.get(domain)
        kept = seen
        if before is not None and not seen.complete:
            read = tuple(dict.fromkeys((*seen.read, *before.read)))
            parameters = seen.parameters or before.parameters
            kept = EditorFindings(seen.findings, read, False, before.examples, parameters)
        self.desk.seen[domain] = kept
        by_file: dict[str, list[Diagnostic]] = {
            checked_path: [] for checked_path in (*seen.read, *edited)
        }
        for finding in seen.findings:
            by_file.setdefault(os.path.abspath(finding.where.path), []).append(finding)
        for path, path_findings in by_file.items():
            if path_findings != self.found.get(path, []) or path in self.desk.texts:
                self.found[path] = path_findings
                self._publish(path, path_findings)

    def _publish(self, path: str, found: list[Diagnostic]) -> None:
        file = self.desk.file(path)
        if file is None and not found:
            return
        lines = self.desk.lines(file) if file is not None else TextLines("")
        shown = [lsp_diagnostic(finding, lines) for finding in found]
        version = self.desk.versions.get(path)
        self.publish(types.PublishDiagnosticsParams(self.desk.uri(path), shown, version))

    def closed(self, path: str) -> None:
        """Read a domain again without what an editor had of one of its files."""
        self.edited(path)

    def stop(self) -> None:
        """End all work."""
        for task in self._tasks.values():
            task.cancel()
        for helper in self._helpers:
            helper.stop()


def lsp_diagnostic(found: Diagnostic, lines: TextLines) -> types.Diagnostic:
    """A finding as editors show it: at the word that begins at its place; the hint is part of
    the message.
    """
    number = min(max(found.where.line - 1, 0), len(lines.starts) - 1)
    start = lines.starts[number] + max(found.where.column - 1, 0)
    start = min(start, len(lines.text))
    message = found.message + (f"\ntry: {found.hint}" if found.hint else "")
    severity = types.DiagnosticSeverity.Warning if found.warning else types.DiagnosticSeverity.Error
    data: Mapping[str, object] = {"line": found.where.line, "column": found.where.column,
                                  "message": found.message, "hint": found.hint}  # fmt: skip
    return types.Diagnostic(
        lines.range(start, _word_end(lines.text, start, found.where.column)),
        message, severity, found.code, source="cellwright", data=data, related_information=_use_of_device(found.where),
    )  # fmt: skip


def _use_of_device(where: Source) -> list[types.DiagnosticRelatedInformation] | None:
    """Where the device is used in whose file a finding is."""
    if (used := where.used) is None:
        return None
    place = types.Position(max(used.line - 1, 0), max(used.column - 1, 0))
    uri = from_fs_path(os.path.abspath(used.path)) or used.path
    return [
        types.DiagnosticRelatedInformation(
            types.Location(uri, types.Range(place, place)), "used here"
        )
    ]


def _word_end(text: str, start: int, column: int) -> int:
    """Where the word ends that begins at a place; the line, if the finding is about all of it."""
    end = start
    while column and end < len(text) and (text[end].isalnum() or text[end] == "_"):
        end += 1
    if end > start:
        return end
    stop = text.find("\n", start)
    return stop if stop >= 0 else len(text)
