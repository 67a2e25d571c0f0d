"""QIF documents as elements with text. Document types and entities are refused; depth and number of elements are limited.

What only serves to show a part (views, notes, colours) is not kept.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, read_file

MAX_DEPTH = 60
MAX_ELEMENTS = 2_000_000
PASSED_OVER = frozenset(
    {
        "Header",
        "Validation",
        "ViewSet",
        "NoteSet",
        "PartNoteSet",
        "NoteFlagSet",
        "LayerSet",
        "VisualizationSet",
    }
)


@dataclass(slots=True)
class Element:
    """An element: its tag without namespace, its attributes, text, and children in order."""

    tag: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def all(self, tag: str) -> Iterator["Element"]:
        """Its children of this tag."""
        return (child for child in self.children if child.tag == tag)

    def at(self, *path: str) -> "Element | None":
        """The first element at the end of a path of tags."""
        found: Element | None = self
        for tag in path:
            found = next(found.all(tag), None) if found is not None else None
        return found

    def text_at(self, *path: str) -> str:
        """The text at the end of a path, stripped; empty if there is none."""
        found = self.at(*path)
        return found.text.strip() if found is not None else ""


def read_document(path: Path) -> tuple[Element, File]:
    """The root of a QIF document. Raises `InvalidInput`."""
    file = read_file(path)
    reader = _Reader(file)
    root = reader.read()
    if root.tag != "QIFDocument":
        raise wrong(Source(file.path), "not a QIF document", "its root element is QIFDocument")
    return root, file


def wrong(where: Source, message: str, hint: str = "") -> InvalidInput:
    """The error for a QIF file that cannot be read."""
    return InvalidInput([Diagnostic(where, "K804", message, hint)])


class _Reader:
    """Builds the tree. Elements below a skipped element are only counted."""

    def __init__(self, file: File) -> None:
        self._file = file
        self._parser = expat.ParserCreate("utf-8", " ")
        self._parser.buffer_text = True
        self._stack = [Element("", {}, 0)]
        self._skipping = 0
        self._count = 0
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.EntityDeclHandler = self._refuse

    def read(self) -> Element:
        try:
            self._parser.Parse(self._file.text.encode(), True)
        except expat.ExpatError as error:
            where = self._file.line(error.lineno, error.offset + 1)
            said = expat.ErrorString(error.code)
            raise wrong(where, f"not XML: {said}", "close every element") from None
        return self._stack[0].children[0]

    def _here(self) -> Source:
        return self._file.line(self._parser.CurrentLineNumber, self._parser.CurrentColumnNumber + 1)

    def _refuse(self, *_: object) -> None:
        raise wrong(self._here(), "document types and entities are refused", "remove it")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MAX_ELEMENTS or len(self._stack) + self._skipping > MAX_DEPTH:
            raise InvalidInput([Diagnostic(self._here(), "K007", "nested too deeply or too many elements")])
        tag = name.rpartition(" ")[2]
        if self._skipping or tag in PASSED_OVER:
            self._skipping += 1
            return
        element = Element(tag, attributes, self._parser.CurrentLineNumber)
        self._stack[-1].children.append(element)
        self._stack.append(element)

    def _end(self, _name: str) -> None:
        if self._skipping:
            self._skipping -= 1
        else:
            self._stack.pop()

    def _text(self, text: str) -> None:
        if not self._skipping:
            self._stack[-1].text += text
