"""The grammar of a domain's commands, generated from its phrases for lark's Earley parser.

Every word is a separate terminal, so that it may be a noun in one place and part of a phrase in another. "and" and "," join
objects as well as clauses. The Earley parser keeps both readings open; if a sentence allows both, the earlier rule wins.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from lark import Lark, Token, Tree, UnexpectedEOF, UnexpectedToken
from lark.lexer import Lexer

from kb.commands.patterns import ARTICLES, Slot, Word, expansions
from kb.commands.phrases import Meaning
from kb.commands.tokens import NAME, NUMBER, TIME, Piece, pieces
from kb.model.domain import BUILT_IN_TYPES, NUMERIC_TYPES, Domain

PRONOUNS = ("it", "them", "they", "these", "those", "both")
THEN = ("then", "afterwards", "finally", "next")

_FRAME = """
start: clause (_join clause)* STOP?
_join: and | then
and: _more | SEMICOLON | STOP
then: (_more | SEMICOLON | STOP)? then_ COMMA?
_more: COMMA | and_ | COMMA and_ | COMMA? AMPERSAND
_until: to_ | DASH | DOTS
pronoun: pronoun_ | (both_ | all_) of_ pronoun_
"""
_TERMINALS = ("COMMA", "SEMICOLON", "STOP", "DOTS", "DASH", "AMPERSAND", NUMBER, TIME, NAME)
_BETWEEN = ("DOTS", "DASH")


@dataclass(frozen=True, slots=True)
class Mention:
    """One part of a list: how it names objects, the owner of its noun (a type, or an object with its own words), and its ends.

    `how` is `numbered`, `numbers` (a range), `named`, `names` (a range), `sole` (a noun alone) or `called`.
    """

    how: str
    owner: str
    ends: tuple[Piece, ...]
    pieces: tuple[Piece, ...]


@dataclass(frozen=True, slots=True)
class Words:
    """The content of a slot: a `list` of mentions, `all`, `both` or a `pronoun` with one mention, or a `value`."""

    how: str
    pieces: tuple[Piece, ...]
    mentions: tuple[Mention, ...] = ()


@dataclass(frozen=True, slots=True)
class Clause:
    """One phrase in a sentence: its number, the content of its slots, where it begins, and whether "then" precedes it."""

    phrase: int
    slots: Mapping[str, Words]
    offset: int
    then: bool


class NotUnderstood(Exception):
    """The sentence is not understood from token `index` on. `expected` holds the kinds of tokens that are possible there."""

    def __init__(self, said: Sequence[Piece], index: int, expected: frozenset[str]) -> None:
        super().__init__("not understood")
        self.said, self.index, self.expected = tuple(said), index, expected


class _Given(Lexer):
    """A lexer that passes on ready-made tokens."""

    def __init__(self, _configuration: Any) -> None:
        pass

    def lex(
        self, lexer_state: Any, _parser_state: Any = None
    ) -> Iterator[Token]:  # lark passes only the input
        return iter(lexer_state)


@lru_cache(maxsize=8)
def _parser(grammar: str) -> Lark:
    return Lark(grammar, parser="earley", lexer=_Given, maybe_placeholders=False)


class CommandGrammar:
    """The grammar of one domain. It parses sentences about `objects` (name: type)."""

    def __init__(self, domain: Domain, meanings: Sequence[Meaning], objects: Mapping[str, str]) -> None:
        self.domain, self.meanings, self.objects = domain, meanings, objects
        self.kinds: dict[str, str] = {}  # word: its terminal
        self.owners: list[str] = []  # types and objects with nouns
        text = self._text()
        self.words = frozenset(self.kinds)
        self.names = frozenset(objects) - self.words
        self.said_by = {terminal: word for word, terminal in self.kinds.items()}
        declared = sorted({*self.kinds.values(), *_TERMINALS})
        self.parser = _parser(f"{text}\n%declare {' '.join(declared)}\n")

    def parse(self, sentence: str) -> list[Clause]:
        """The clauses of a sentence. Raises `NotUnderstood`."""
        said = list(pieces(sentence, self.words, self.names))
        tokens = [self._token(piece, index) for index, piece in enumerate(said)]
        try:
            tree = self.parser.parse(tokens)
        except UnexpectedToken as error:
            raise NotUnderstood(
                said, int(error.token.start_pos or 0), self._readable(error.expected)
            ) from None
        except UnexpectedEOF as error:
            raise NotUnderstood(said, len(said), self._readable(error.expected)) from None
        return list(self._clauses(tree, said))

    def _token(self, piece: Piece, index: int) -> Token:
        return Token(self.kinds.get(piece.kind, piece.kind), piece.text, start_pos=index)

    def _readable(self, expected: Any) -> frozenset[str]:
        return frozenset(self.said_by.get(kind, kind) for kind in expected)

    # from phrases to rules

    def _text(self) -> str:
        rules = [re.sub(r"\b(and|then|to|all|of|both|pronoun)_", self._reserved, _FRAME)]
        rules.append(f"clause: {' | '.join(f'phrase_{index}' for index, _ in enumerate(self.meanings))}")
        for index, meaning in enumerate(self.meanings):
            options = " | ".join(self._option(each, index, meaning) for each in expansions(meaning.pattern))
            rules.append(f"phrase_{index}: {options}")
            rules += [self._slot(index, number, slot) for number, slot in enumerate(meaning.slots)]
        for type_ in self._slot_types():
            rules += self._objects(type_)
        rules += [f"own_{number}: {said}" for number, said in enumerate(self._owned())]
        return "\n".join(rules)

    def _reserved(self, found: re.Match[str]) -> str:
        words = {"then": THEN, "pronoun": PRONOUNS}.get(found[1], (found[1],))
        return f"({' | '.join(map(self._terminal, words))})"

    def _terminal(self, word: str) -> str:
        return self.kinds.setdefault(word, f"W{len(self.kinds)}")

    def _said(self, words: str) -> str:
        return " ".join(self._terminal(word) for word in words.lower().split() if word not in ARTICLES)

    def _option(self, parts: tuple[Word | Slot, ...], index: int, meaning: Meaning) -> str:
        numbers = {slot.variable: number for number, slot in enumerate(meaning.slots)}
        return " ".join(
            self._terminal(part.text) if isinstance(part, Word) else f"slot_{index}_{numbers[part.variable]}"
            for part in parts
        )

    def _slot(self, index: int, number: int, slot: Slot) -> str:
        inner = {"int": NUMBER, "time": TIME}.get(slot.type, f"_objects_{slot.type}")
        return f"slot_{index}_{number}: {inner}"

    def _slot_types(self) -> list[str]:
        found = dict.fromkeys(slot.type for meaning in self.meanings for slot in meaning.slots)
        return [type_ for type_ in found if type_ not in NUMERIC_TYPES]

    def _objects(self, type_: str) -> Iterator[str]:
        """The rules for the content of a slot of a type."""
        noun, name = f"_noun_{type_}", f"_name_{type_}"
        nouns = [self._owner(each) for each in self._below(type_)]
        things = [self._owner(each) for each in self.domain.words if self._is(each, type_)]
        plain = [each for each in self.objects if self._is(each, type_) and each in self._phrase_words]
        yield f"_objects_{type_}: item_{type_} (_more item_{type_})* | all_{type_} | both_{type_} | pronoun"
        yield f"all_{type_}: {self._terminal('all')} ({self._terminal('of')}? {noun})?"
        yield f"both_{type_}: {self._terminal('both')} {self._terminal('of')}? {noun}"
        yield f"item_{type_}: {noun}? {NUMBER} -> numbered"
        yield f"    | {noun}? {NUMBER} _until {noun}? {NUMBER} -> numbers"
        yield f"    | {noun}? {name} -> named"
        yield f"    | {noun}? {name} _until ({name} | {NUMBER}) -> names"
        yield f"    | {noun} -> sole"
        yield from (f"    | {thing} -> called" for thing in things)
        yield f"{noun}: {' | '.join(nouns)}"
        yield f"{name}: {' | '.join([NAME, *map(self._terminal, plain)])}"

    def _below(self, type_: str) -> Iterator[str]:
        if type_ in BUILT_IN_TYPES:
            yield type_
        yield from (each for each in self.domain.types if self.domain.is_subtype(each, type_))

    def _is(self, name: str, type_: str) -> bool:
        return name in self.objects and self.domain.is_subtype(self.objects[name], type_)

    @cached_property
    def _phrase_words(self) -> frozenset[str]:
        parts = (part for m in self.meanings for each in expansions(m.pattern) for part in each)
        return frozenset(part.text for part in parts if isinstance(part, Word))

    def _owner(self, name: str) -> str:
        """The rule for the nouns of a type or the names of an object."""
        if name not in self.owners:
            self.owners.append(name)
        return f"own_{self.owners.index(name)}"

    def _owned(self) -> Iterator[str]:
        for name in self.owners:
            plain = name.replace("_", " ")
            said = self.domain.words.get(name, (plain, f"{plain}s"))
            yield " | ".join(filter(None, dict.fromkeys(map(self._said, said))))

    # from the tree to values

    def _clauses(self, tree: Tree[Token], said: Sequence[Piece]) -> Iterator[Clause]:
        then = False
        for child in tree.children:
            if isinstance(child, Tree) and child.data == "clause":
                yield self._clause(child, said, then)
            elif isinstance(child, Tree):
                then = child.data == "then"

    def _clause(self, tree: Tree[Token], said: Sequence[Piece], then: bool) -> Clause:
        phrase = tree.children[0]
        assert isinstance(phrase, Tree)
        number = int(str(phrase.data).rsplit("_", 1)[1])
        first = next(phrase.scan_values(lambda _: True))
        slots = {}
        for child in phrase.children:
            if isinstance(child, Tree):
                slot = self.meanings[number].slots[int(str(child.data).rsplit("_", 1)[1])]
                slots[slot.variable] = self._words(child, said)
        return Clause(number, slots, said[int(first.start_pos or 0)].offset, then)

    def _words(self, slot: Tree[Token], said: Sequence[Piece]) -> Words:
        used = _pieces(slot, said)
        inner = [child for child in slot.children if isinstance(child, Tree)]
        if not inner:
            return Words("value", used)
        how = str(inner[0].data).split("_")[0]
        if how in ("all", "both", "pronoun"):
            return Words(how, used, (self._mention(inner[0], said),))
        return Words("list", used, tuple(self._mention(each, said) for each in inner))

    def _mention(self, tree: Tree[Token], said: Sequence[Piece]) -> Mention:
        owners = [
            self.owners[int(str(t.data)[4:])] for t in tree.iter_subtrees() if str(t.data).startswith("own_")
        ]
        tokens = [child for child in tree.children if isinstance(child, Token)]
        ends = [said[int(token.start_pos or 0)] for token in tokens if token.type not in _BETWEEN]
        ends = [end for end in ends if end.kind not in ("to", "all", "both", "of")]
        return Mention(str(tree.data), owners[0] if owners else "", tuple(ends), _pieces(tree, said))


def _pieces(tree: Tree[Token], said: Sequence[Piece]) -> tuple[Piece, ...]:
    return tuple(said[int(token.start_pos or 0)] for token in tree.scan_values(lambda _: True))
