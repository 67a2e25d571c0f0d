"""Changes of texts: new names, what can be done about a finding, form."""

from collections.abc import Iterable

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams

from cellwright.engine.faces.lsp.desk import Desk, Here
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.editing.changing import Change, NotRenamed, renamed, renaming
from cellwright.kb.editing.fixes import Fix, fixes
from cellwright.kb.editing.layout import formatted


def prepare_rename(
    desk: Desk, asked: types.TextDocumentPositionParams
) -> types.PrepareRenamePlaceholder | None:
    """The name that would be changed. Raises an error of the protocol if it cannot be."""
    if (here := desk.here(asked.text_document.uri)) is None:
        return None
    try:
        _, place = renaming(here.index, here.file, here.lines.offset(asked.position))
    except NotRenamed as refused:
        raise JsonRpcInvalidParams(message=str(refused)) from None
    return types.PrepareRenamePlaceholder(here.lines.range(place.start, place.end), place.name)


def rename(desk: Desk, asked: types.RenameParams) -> types.WorkspaceEdit | None:
    """The changes that give a name its new form in all files."""
    if (here := desk.here(asked.text_document.uri)) is None:
        return None
    try:
        offset = here.lines.offset(asked.position)
        return workspace_edit(desk, renamed(here.index, here.file, offset, asked.new_name))
    except NotRenamed as refused:
        raise JsonRpcInvalidParams(message=str(refused)) from None


def workspace_edit(desk: Desk, changes: Iterable[Change]) -> types.WorkspaceEdit:
    """Changes of files as the editor applies them."""
    edits: dict[str, list[types.TextEdit]] = {}
    for each in changes:
        if (file := desk.file(each.path)) is None:
            continue
        edit = types.TextEdit(desk.lines(file).range(each.start, each.end), each.text)
        edits.setdefault(desk.uri(each.path), []).append(edit)
    return types.WorkspaceEdit(changes=edits)


def actions(desk: Desk, asked: types.CodeActionParams) -> list[types.CodeAction]:
    """What can be done about the findings at a place."""
    here = desk.here(asked.text_document.uri) if asked.context.diagnostics else None
    if here is None:
        return []
    return [
        _action(desk, shown, fix)
        for shown in asked.context.diagnostics
        if (finding := _finding(here, shown)) is not None
        for fix in fixes(here.index, here.file, finding)
    ]


def _action(desk: Desk, shown: types.Diagnostic, fix: Fix) -> types.CodeAction:
    return types.CodeAction(
        fix.title,
        kind=types.CodeActionKind.QuickFix,
        diagnostics=[shown],
        is_preferred=fix.preferred,
        edit=workspace_edit(desk, fix.changes),
    )


def _finding(here: Here, shown: types.Diagnostic) -> Diagnostic | None:
    """The finding that an editor shows, where it is now. Editors move findings along with the text."""
    if shown.source != "cellwright" or not isinstance(shown.code, str):
        return None
    message, _, hint = shown.message.partition("\ntry: ")
    start = here.lines.offset(shown.range.start)
    before = here.file.text[:start]
    where = Source(here.file.path, before.count("\n") + 1, start - (before.rfind("\n") + 1) + 1)
    return Diagnostic(where, shown.code, message, hint)


def formatting(desk: Desk, asked: types.DocumentFormattingParams) -> list[types.TextEdit]:
    """The text in its usual form, as one change; none if it is broken."""
    if (page := desk.page(asked.text_document.uri)) is None:
        return []
    try:
        text = formatted(page.file.path, page.file.text)
    except InvalidInput:
        return []
    if text == page.file.text:
        return []
    return [types.TextEdit(page.lines.range(0, len(page.file.text)), text)]
