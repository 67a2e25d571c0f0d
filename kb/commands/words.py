"""What is said in a slot of a phrase, as it is read, before it is known which objects are meant."""

from dataclasses import dataclass

from cellwright.kb.commands.tokens import Piece


class Unclear(Exception):
    """A part of a sentence names nothing, or is ambiguous. `offset` is its place."""

    def __init__(self, offset: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.offset, self.message, self.hint = offset, message, hint


@dataclass(frozen=True, slots=True)
class Mention:
    """One part of a list: how it names objects, the owner of its noun (a type, or an object with its own words), and its ends.

    `how` is `numbered`, `numbers` (a range), `named`, `names` (a range), `sole` (a noun alone), `called`, `counted`
    (a number before a noun, or a number in words alone) or `ranked` ("the first two": an ordinal, and how many).
    """

    how: str
    owner: str
    ends: tuple[Piece, ...]
    pieces: tuple[Piece, ...]


@dataclass(frozen=True, slots=True)
class Words:
    """The content of a slot. `how` is `list`, `all`, `bare` ("all" without a noun), `both`, `others`, `pronoun`, `omitted` or `value`.

    An `omitted` one was not said at all. `owner` is the type whose noun was said with it; `but` holds what "except" leaves out.
    """

    how: str
    pieces: tuple[Piece, ...]
    mentions: tuple[Mention, ...] = ()
    owner: str = ""
    but: tuple[Mention, ...] = ()

    @property
    def leans_back(self) -> bool:
        """Whether this means things that were named before: "cool it", "and store"."""
        return self.how in ("pronoun", "omitted")
