"""Answers about names: what they are, where they stand, what fits, what a file holds."""

from lsprotocol import types

from cellwright.engine.faces.lsp.desk import Desk, Here, Page
from cellwright.kb.editing.completing import Completion, completions
from cellwright.kb.editing.describing import comment, description
from cellwright.kb.editing.index import FileIndex, Symbol
from cellwright.kb.editing.occurrences import Occurrence
from cellwright.kb.editing.outline import Entry, outline

COMPLETED = {
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
OUTLINED = {
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
SPACES = {
    "predicate": types.SymbolKind.Function,
    "type": types.SymbolKind.Class,
    "operator": types.SymbolKind.Method,
    "object": types.SymbolKind.Constant,
    "function": types.SymbolKind.Constructor,
}
MOST = 500  # symbols of a workspace in one answer
Place = types.TextDocumentPositionParams | types.ReferenceParams


def hover(desk: Desk, asked: Place) -> types.Hover | None:
    """What stands at a place."""
    if (here := desk.here(asked.text_document.uri)) is None:
        return None
    known = desk.known(here.file.path)
    found = description(here.index, here.file, here.lines.offset(asked.position), known)
    if found is None:
        return None
    text, start, end = found
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, here.lines.range(start, end))


def completion(desk: Desk, asked: Place) -> types.CompletionList:
    """What fits at a place."""
    if (here := desk.here(asked.text_document.uri)) is None:
        return types.CompletionList(False, [])
    offset = here.lines.offset(asked.position)
    found = completions(here.index, here.file, offset)
    return types.CompletionList(False, [_item(here, offset, each, n) for n, each in enumerate(found)])


def _item(here: Here, offset: int, each: Completion, number: int) -> types.CompletionItem:
    edit = types.TextEdit(here.lines.range(offset - each.length, offset), each.insert or each.label)
    snippet = "$" in each.insert
    declared = here.index.declarations.get((each.kind, each.label))
    said = each.text or (comment(declared[0][0], declared[0][1].start) if declared and number < 100 else "")
    return types.CompletionItem(
        each.label,
        kind=COMPLETED.get(each.kind, types.CompletionItemKind.Text),
        detail=each.detail or None,
        documentation=said or None,
        sort_text=f"{number:05d}",
        insert_text_format=types.InsertTextFormat.Snippet if snippet else types.InsertTextFormat.PlainText,
        text_edit=edit,
    )


def _symbol(desk: Desk, asked: Place) -> tuple[Here, Symbol] | None:
    here = desk.here(asked.text_document.uri)
    found = here.index.symbol(here.file, here.lines.offset(asked.position)) if here else None
    return None if here is None or found is None else (here, found[0])


def definition(desk: Desk, asked: Place) -> list[types.Location]:
    """Where a name is declared, and the rules that define it."""
    if (found := _symbol(desk, asked)) is None:
        return []
    here, symbol = found
    if symbol.space == "file":
        return [
            location for file in here.index.files.values() if (location := _whole(desk, file, symbol.name))
        ]
    if symbol.space == "domain":
        domain = desk.domain(here.file.path)
        return [types.Location(desk.uri(domain), types.Range(types.Position(0, 0), types.Position(0, 0)))]
    return [_location(desk, *each) for each in here.index.definitions(symbol)]


def _whole(desk: Desk, file: FileIndex, name: str) -> types.Location | None:
    """The beginning of an included file."""
    if not file.path.endswith(f"/{name}"):
        return None
    return types.Location(desk.uri(file.path), types.Range(types.Position(0, 0), types.Position(0, 0)))


def references(desk: Desk, asked: types.ReferenceParams) -> list[types.Location]:
    """Every place that names what stands at a place."""
    if (found := _symbol(desk, asked)) is None:
        return []
    here, symbol = found
    uses = here.index.uses(symbol)
    told = asked.context.include_declaration
    return [_location(desk, file, each) for file, each in uses if told or each.doing != "declared"]


def highlights(desk: Desk, asked: Place) -> list[types.DocumentHighlight]:
    """The places of a name in its own file."""
    if (found := _symbol(desk, asked)) is None:
        return []
    here, symbol = found
    written = ("declared", "defined", "added", "denied", "changed")
    kinds = types.DocumentHighlightKind
    return [
        types.DocumentHighlight(
            here.lines.range(each.start, each.end), kinds.Write if each.doing in written else kinds.Read
        )
        for file, each in here.index.uses(symbol)
        if file.path == here.file.path
    ]


def _location(desk: Desk, file: FileIndex, each: Occurrence) -> types.Location:
    return types.Location(desk.uri(file.path), desk.lines(file).range(each.start, each.end))


def symbols(desk: Desk, asked: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
    """The outline of a file."""
    page = desk.page(asked.text_document.uri)
    return [] if page is None else [_entry(page, each) for each in outline(page.file)]


def _entry(page: Page, each: Entry) -> types.DocumentSymbol:
    end = max(each.end, each.name_end)
    return types.DocumentSymbol(
        each.name or "?",
        OUTLINED.get(each.kind, types.SymbolKind.Object),
        page.lines.range(each.start, end),
        page.lines.range(each.name_start, each.name_end),
        children=[_entry(page, part) for part in each.parts],
    )


def workspace_symbols(desk: Desk, asked: types.WorkspaceSymbolParams) -> list[types.WorkspaceSymbol]:
    """The declared names that contain a text, in the domains of open files."""
    found: dict[tuple[str, int, str], types.WorkspaceSymbol] = {}
    for path in list(desk.texts):
        file = desk.file(path)
        for (space, name), places in desk.index(path, file).declarations.items() if file else ():
            if space in SPACES and asked.query.lower() in name.lower():
                home, each = places[0]
                where = types.Location(desk.uri(home.path), desk.lines(home).range(each.start, each.end))
                found[home.path, each.start, name] = types.WorkspaceSymbol(where, name, SPACES[space])
    return list(found.values())[:MOST]
