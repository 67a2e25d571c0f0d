"""Answers to an editor's requests: hover, completion, definitions, symbols, renaming, fixes."""

from collections.abc import Iterable

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams

from cellwright.engine.faces.lsp.open_files import IndexedPage, OpenFiles, Page
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.editing.completions import Completion, list_completions
from cellwright.kb.editing.file_layout import format_file
from cellwright.kb.editing.name_descriptions import (
    OutlineEntry,
    comment_at,
    describe_name,
    file_outline,
)
from cellwright.kb.editing.name_index import FileIndex, Symbol
from cellwright.kb.editing.name_occurrences import Occurrence
from cellwright.kb.editing.text_changes import (
    Fix,
    NotRenamed,
    TextChange,
    fixes_of,
    rename_occurrences,
    symbol_to_rename,
)

LSP_COMPLETION_KINDS = {
    "key": types.CompletionItemKind.Property,
    "value": types.CompletionItemKind.EnumMember,
    "predicate": types.CompletionItemKind.Function,
    "function": types.CompletionItemKind.Constructor,
    "operator": types.CompletionItemKind.Method,
    "object": types.CompletionItemKind.Constant,
    "type": types.CompletionItemKind.Class,
    "variable": types.CompletionItemKind.Variable,
    "phrase": types.CompletionItemKind.Snippet,
    "cause": types.CompletionItemKind.Event,
}
OUTLINE_KINDS = {
    "section": types.SymbolKind.Namespace,
    "types": types.SymbolKind.Class,
    "functions": types.SymbolKind.Constructor,
    "objects": types.SymbolKind.Constant,
    "operators": types.SymbolKind.Method,
    "predicate": types.SymbolKind.Function,
    "rule": types.SymbolKind.Function,
    "events": types.SymbolKind.Event,
    "fluents": types.SymbolKind.Function,
    "statics": types.SymbolKind.Function,
    "derived": types.SymbolKind.Function,
}
WORKSPACE_KINDS = {
    "predicate": types.SymbolKind.Function,
    "type": types.SymbolKind.Class,
    "operator": types.SymbolKind.Method,
    "object": types.SymbolKind.Constant,
    "function": types.SymbolKind.Constructor,
}
MAX_WORKSPACE_SYMBOLS = 500  # symbols of a workspace in one answer
Place = types.TextDocumentPositionParams | types.ReferenceParams


def hover_text(desk: OpenFiles, asked: Place) -> types.Hover | None:
    """What stands at a place."""
    if (page := desk.here(asked.text_document.uri)) is None:
        return None
    known = desk.known(page.file.path)
    described = describe_name(page.index, page.file, page.lines.offset(asked.position), known)
    if described is None:
        return None
    text, start, end = described
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, page.lines.range(start, end))


def complete_name(desk: OpenFiles, asked: Place) -> types.CompletionList:
    """What fits at a place."""
    if (page := desk.here(asked.text_document.uri)) is None:
        return types.CompletionList(False, [])
    offset = page.lines.offset(asked.position)
    candidates = list_completions(page.index, page.file, offset)
    return types.CompletionList(
        False,
        [_completion_item(page, offset, candidate, n) for n, candidate in enumerate(candidates)],
    )


def _completion_item(
    here: IndexedPage, offset: int, each: Completion, number: int
) -> types.CompletionItem:
    edit = types.TextEdit(here.lines.range(offset - each.length, offset), each.insert or each.label)
    snippet = "$" in each.insert
    declared = here.index.declarations.get((each.kind, each.label))
    comment_text = each.text or (
        comment_at(declared[0][0], declared[0][1].start) if declared and number < 100 else ""
    )
    return types.CompletionItem(
        each.label,
        kind=LSP_COMPLETION_KINDS.get(each.kind, types.CompletionItemKind.Text),
        detail=each.detail or None,
        documentation=comment_text or None,
        sort_text=f"{number:05d}",
        insert_text_format=types.InsertTextFormat.Snippet
        if snippet
        else types.InsertTextFormat.PlainText,
        text_edit=edit,
    )


def _symbol_at(desk: OpenFiles, asked: Place) -> tuple[IndexedPage, Symbol] | None:
    page = desk.here(asked.text_document.uri)
    symbols_there = (
        page.index.symbol(page.file, page.lines.offset(asked.position)) if page else None
    )
    return None if page is None or symbols_there is None else (page, symbols_there[0])


def find_definitions(desk: OpenFiles, asked: Place) -> list[types.Location]:
    """Where a name is declared, and the rules that define it."""
    if (page_symbol := _symbol_at(desk, asked)) is None:
        return []
    page, symbol = page_symbol
    if symbol.space == "file":
        return [
            location
            for file in page.index.files.values()
            if (location := _file_location(desk, file, symbol.name))
        ]
    if symbol.space == "domain":
        domain = desk.domain(page.file.path)
        return [
            types.Location(
                desk.uri(domain), types.Range(types.Position(0, 0), types.Position(0, 0))
            )
        ]
    return [_name_location(desk, *place) for place in page.index.definitions(symbol)]


def _file_location(desk: OpenFiles, file: FileIndex, name: str) -> types.Location | None:
    """The beginning of an included file."""
    if not file.path.endswith(f"/{name}"):
        return None
    return types.Location(
        desk.uri(file.path), types.Range(types.Position(0, 0), types.Position(0, 0))
    )


def find_references(desk: OpenFiles, asked: types.ReferenceParams) -> list[types.Location]:
    """Every place that names what stands at a place."""
    if (page_symbol := _symbol_at(desk, asked)) is None:
        return []
    page, symbol = page_symbol
    uses = page.index.uses(symbol)
    with_declaration = asked.context.include_declaration
    return [
        _name_location(desk, file, occurrence)
        for file, occurrence in uses
        if with_declaration or occurrence.doing != "declared"
    ]


def find_highlights(desk: OpenFiles, asked: Place) -> list[types.DocumentHighlight]:
    """The places of a name in its own file."""
    if (page_symbol := _symbol_at(desk, asked)) is None:
        return []
    page, symbol = page_symbol
    written = ("declared", "defined", "added", "denied", "changed")
    kinds = types.DocumentHighlightKind
    return [
        types.DocumentHighlight(
            page.lines.range(occurrence.start, occurrence.end),
            kinds.Write if occurrence.doing in written else kinds.Read,
        )
        for file, occurrence in page.index.uses(symbol)
        if file.path == page.file.path
    ]


def _name_location(desk: OpenFiles, file: FileIndex, each: Occurrence) -> types.Location:
    return types.Location(desk.uri(file.path), desk.lines(file).range(each.start, each.end))


def outline_symbols(
    desk: OpenFiles, asked: types.DocumentSymbolParams
) -> list[types.DocumentSymbol]:
    """The outline of a file."""
    page = desk.page(asked.text_document.uri)
    return (
        [] if page is None else [_outline_entry(page, entry) for entry in file_outline(page.file)]
    )


def _outline_entry(page: Page, each: OutlineEntry) -> types.DocumentSymbol:
    end = max(each.end, each.name_end)
    return types.DocumentSymbol(
        each.name or "?",
        OUTLINE_KINDS.get(each.kind, types.SymbolKind.Object),
        page.lines.range(each.start, end),
        page.lines.range(each.name_start, each.name_end),
        children=[_outline_entry(page, part) for part in each.parts],
    )


def workspace_symbols(
    desk: OpenFiles, asked: types.WorkspaceSymbolParams
) -> list[types.WorkspaceSymbol]:
    """The declared names that contain a text, in the domains of open files."""
    matches: dict[tuple[str, int, str], types.WorkspaceSymbol] = {}
    for path in list(desk.texts):
        file = desk.file(path)
        for (space, name), places in desk.index(path, file).declarations.items() if file else ():
            if space in WORKSPACE_KINDS and asked.query.lower() in name.lower():
                home, declaration = places[0]
                where = types.Location(
                    desk.uri(home.path), desk.lines(home).range(declaration.start, declaration.end)
                )
                matches[home.path, declaration.start, name] = types.WorkspaceSymbol(
                    where, name, WORKSPACE_KINDS[space]
                )
    return list(matches.values())[:MAX_WORKSPACE_SYMBOLS]


def prepare_rename(
    desk: OpenFiles, asked: types.TextDocumentPositionParams
) -> types.PrepareRenamePlaceholder | None:
    """The name that would be changed. Raises an error of the protocol if it cannot be."""
    if (page := desk.here(asked.text_document.uri)) is None:
        return None
    try:
        _, place = symbol_to_rename(page.index, page.file, page.lines.offset(asked.position))
    except NotRenamed as refused:
        raise JsonRpcInvalidParams(message=str(refused)) from None
    return types.PrepareRenamePlaceholder(page.lines.range(place.start, place.end), place.name)


def rename_edit(desk: OpenFiles, asked: types.RenameParams) -> types.WorkspaceEdit | None:
    """The changes that give a name its new form in all files."""
    if (page := desk.here(asked.text_document.uri)) is None:
        return None
    try:
        offset = page.lines.offset(asked.position)
        return workspace_edit(
            desk, rename_occurrences(page.index, page.file, offset, asked.new_name)
        )
    except NotRenamed as refused:
        raise JsonRpcInvalidParams(message=str(refused)) from None


def workspace_edit(desk: OpenFiles, changes: Iterable[TextChange]) -> types.WorkspaceEdit:
    """Changes of files as the editor applies them."""
    edits: dict[str, list[types.TextEdit]] = {}
    for change in changes:
        if (file := desk.file(change.path)) is None:
            continue
        edit = types.TextEdit(desk.lines(file).range(change.start, change.end), change.text)
        edits.setdefault(desk.uri(change.path), []).append(edit)
    return types.WorkspaceEdit(changes=edits)


def code_actions(desk: OpenFiles, asked: types.CodeActionParams) -> list[types.CodeAction]:
    """What can be done about the findings at a place."""
    page = desk.here(asked.text_document.uri) if asked.context.diagnostics else None
    if page is None:
        return []
    return [
        _fix_action(desk, shown, fix)
        for shown in asked.context.diagnostics
        if (finding := _finding_now(page, shown)) is not None
        for fix in fixes_of(page.index, page.file, finding)
    ]


def _fix_action(desk: OpenFiles, shown: types.Diagnostic, fix: Fix) -> types.CodeAction:
    return types.CodeAction(
        fix.title,
        kind=types.CodeActionKind.QuickFix,
        diagnostics=[shown],
        is_preferred=fix.preferred,
        edit=workspace_edit(desk, fix.changes),
    )


def _finding_now(here: IndexedPage, shown: types.Diagnostic) -> Diagnostic | None:
    """The finding that an editor shows, where it is now.

    Editors move findings along with the text.
    """
    if shown.source != "cellwright" or not isinstance(shown.code, str):
        return None
    message, _, hint = shown.message.partition("\ntry: ")
    start = here.lines.offset(shown.range.start)
    before = here.file.text[:start]
    where = Source(here.file.path, before.count("\n") + 1, start - (before.rfind("\n") + 1) + 1)
    return Diagnostic(where, shown.code, message, hint)


def format_text(desk: OpenFiles, asked: types.DocumentFormattingParams) -> list[types.TextEdit]:
    """The text in its usual form, as one change; none if it is broken."""
    if (page := desk.page(asked.text_document.uri)) is None:
        return []
    try:
        text = format_file(page.file.path, page.file.text)
    except InvalidInput:
        return []
    if text == page.file.text:
        return []
    return [types.TextEdit(page.lines.range(0, len(page.file.text)), text)]
