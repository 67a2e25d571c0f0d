"""Strict XML: elements that know their places, without document types and entities."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File

MAX_XML_DEPTH = 50
MAX_XML_ELEMENTS = 200_000


@dataclass(frozen=True, slots=True)
class XmlElement:
    """An element: its tag, attributes, children in order, and place."""

    tag: str
    attributes: Mapping[str, str]
    where: Source
    children: list["XmlElement"] = field(default_factory=list)
    words: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Its own text, without blanks around it."""
        return "".join(self.words).strip()

    def all(self, tag: str) -> Iterator["XmlElement"]:
        """Its children of this tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> "XmlElement | None":
        """Its first child of this tag."""
        return next(self.all(tag), None)

    def get(self, name: str, default: str = "") -> str:
        """An attribute."""
        return self.attributes.get(name, default)


def read_xml(file: File) -> XmlElement:
    """The root element of a file.

    Raises `InvalidInput` if it is not well-formed, or has a document type or entities.
    """
    parser = expat.ParserCreate("utf-8")  # whatever the document says: it was read as UTF-8
    stack: list[XmlElement] = [XmlElement("", {}, Source(file.path))]
    count = 0

    def here() -> Source:
        return file.line(parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def refuse(*_: object) -> None:
        raise InvalidInput(
            [Diagnostic(here(), "K703", "document types and entities are refused", "remove it")]
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) > MAX_XML_DEPTH or count > MAX_XML_ELEMENTS:
            raise InvalidInput(
                [Diagnostic(here(), "K007", "nested too deeply or too many elements")]
            )
        element = XmlElement(tag, attributes, here())
        stack[-1].children.append(element)
        stack.append(element)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = lambda data: stack[-1].words.append(data)
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(file.text.encode(), True)
    except expat.ExpatError as error:
        where = file.line(error.lineno, error.offset + 1)
        said = expat.ErrorString(error.code)
        raise InvalidInput(
            [Diagnostic(where, "K703", f"not XML: {said}", "close every element")]
        ) from None
    return stack[0].children[0]
