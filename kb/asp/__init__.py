"""The only way to clingo: texts are checked, programs grounded, and their true atoms read.

Programs that are grounded here are stratified, so the grounder evaluates them and no solver runs.
Large results leave as tables of integers, through one theory atom for each table. clingo writes its
text in C++, which is about six times faster than asking for symbols one by one.
"""

import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import clingo

from cellwright.kb.asp.bounded_grounding import run_bounded
from cellwright.kb.asp.integer_tables import IntegerTable, read_integer_table
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import Function, Number, Term, Text, is_ground


class AspError(Exception):
    """clingo refused a program.

    `messages` are (line, column, text); lines of that text count from 1.
    """

    def __init__(self, messages: Iterable[tuple[int, int, str]]) -> None:
        self.messages = list(messages)
        super().__init__("; ".join(text for _, _, text in self.messages))


class Messages:
    """Collects clingo's messages; they are not printed."""

    _PLACE = re.compile(
        r"<?[\w-]*>?:(\d+):(\d+)(?:-[\d:]+)?: (?:error|info|warning): (.*)", re.DOTALL
    )

    def __init__(self) -> None:
        self.heard: list[tuple[int, int, str]] = []

    def __call__(self, _code: clingo.MessageCode, text: str) -> None:
        self.hear(text)

    def hear(self, text: str) -> None:
        """Stores a message, with its place in the text as line and column."""
        place_match = self._PLACE.match(text)
        line, column, message = (
            (int(place_match[1]), int(place_match[2]), place_match[3])
            if place_match
            else (0, 0, text)
        )
        self.heard.append((line, column, " ".join(message.split())))


class Grounder:
    """Grounds text step by step, and returns the atoms that became true."""

    def __init__(self) -> None:
        self._messages = Messages()
        self._control = clingo.Control(["--warn=none"], logger=self._messages, message_limit=50)
        self._control.add("base", [], "#theory table { none {}; &rows/1: none, any }.")
        self._control.ground([("base", [])])
        self._parts = 0
        self._tables = 0
        self._given: Mapping[tuple[str, int], Mapping[Function, None]] = {}
        self._read: dict[tuple[str, int, bool], list[Function]] = {}

    def know(self, given: Mapping[tuple[str, int], Mapping[Function, None]]) -> None:
        """Take all true atoms of some predicates as they are given: that is quicker than to ask
        clingo for each.

        They must be what clingo would say, also after further text is grounded.
        """
        self._given = given

    def ground(self, text: str) -> None:
        """Adds statements, and everything that follows from them.

        Raises `AspError`, and what `cellwright.kb.asp.bounded_grounding` raises where that takes
        too long.
        """
        if not text or text.isspace():
            return
        self._parts += 1
        self._read.clear()
        part = f"part_{self._parts}"
        try:
            self._control.add(part, [], text)
            run_bounded(lambda: self._control.ground([(part, [])]))
        except UnicodeEncodeError:
            raise AspError([(0, 0, "half a character is no text")]) from None
        except RuntimeError as error:
            raise AspError(self._messages.heard or [(0, 0, str(error))]) from None

    def atoms(self, predicate: str, arity: int) -> list[tuple[Term, ...]]:
        """The argument tuples of every true atom of a predicate, in clingo's order."""
        return [atom.arguments for atom in self.facts(predicate, arity)]

    def facts(self, predicate: str, arity: int) -> Collection[Function]:
        """Every true atom of a predicate, in clingo's order."""
        given_facts = self._given.get((predicate, arity))
        return given_facts.keys() if given_facts is not None else self._true(predicate, arity)

    def _true(self, predicate: str, arity: int, positive: bool = True) -> list[Function]:
        """Every true atom of a predicate, read from clingo once: planner and checker ask for
        the same ones.
        """
        key = predicate, arity, positive
        if key not in self._read:
            symbolic_atoms = self._control.symbolic_atoms.by_signature(predicate, arity, positive)
            self._read[key] = [_read_fact(atom.symbol) for atom in symbolic_atoms]
        return self._read[key]

    def column(self, predicate: str, arity: int, number: int) -> list[str]:
        """The texts of one argument of every true atom of a predicate: its other arguments are
        not read.
        """
        symbolic_atoms = self._control.symbolic_atoms.by_signature(predicate, arity)
        return [str(atom.symbol.arguments[number]) for atom in symbolic_atoms]

    def everything(self) -> Iterator[Function]:
        """Every true atom of every predicate."""
        for name in dict.fromkeys(name for name, _, _ in self._control.symbolic_atoms.signatures):
            yield from self.named(name)

    def named(self, predicate: str) -> Iterator[Function]:
        """Every true atom of a predicate, of any arity."""
        atoms = self._control.symbolic_atoms
        for name, arity, positive in atoms.signatures:
            if name == predicate and positive and (name, arity) in self._given:
                yield from self._given[name, arity]
            elif name == predicate:
                yield from self._true(name, arity, positive)

    def holds(self, atom: Function) -> bool:
        """Whether a ground atom is true."""
        given_facts = self._given.get((atom.name, len(atom.arguments)))
        if given_facts is not None:
            return atom in given_facts
        return self._control.symbolic_atoms[clingo_symbol(atom)] is not None

    def has_more(self, predicate: str, count: int) -> bool:
        """Whether more than so many atoms of a predicate are true. None of them is read."""
        atoms = self._control.symbolic_atoms
        own = (
            atoms.by_signature(name, arity, positive)
            for name, arity, positive in atoms.signatures
            if name == predicate
        )
        listed = itertools.chain.from_iterable(own)
        return next(itertools.islice(listed, count, None), None) is not None

    def tables(self, arities: Mapping[str, int]) -> dict[str, IntegerTable]:
        """For each predicate over integers, its true atoms as sorted rows."""
        first = self._tables
        columns = {name: arity for name, arity in arities.items() if arity}
        statements = []
        for number, (name, arity) in enumerate(columns.items(), first):
            row = ",".join(f"X{index}" for index in range(arity))
            statements.append(f"&rows({number}) {{ {row} : {name}({row}) }}.")
        self._tables += len(columns)
        self.ground("\n".join(statements))
        tables = {
            name: IntegerTable([[]] * len(self.atoms(name, 0)))
            for name in arities
            if name not in columns
        }
        names = list(columns)
        for atom in self._control.theory_atoms:
            number = atom.term.arguments[0].number - first
            if number >= 0:
                tables[names[number]] = read_integer_table(str(atom), columns[names[number]])
        return tables


def _read_fact(symbol: clingo.Symbol) -> Function:
    """An atom. Most are read from their text, which clingo writes in less time than it gives
    arguments one by one.
    """
    text = str(symbol)
    # what grounding invents has names with a bar in front, which is no plain name
    bare = text.lstrip("_")
    plain = plain_terms(bare)
    fact = plain[0] if plain is not None else term_of_symbol(symbol)
    assert isinstance(fact, Function)
    return (
        fact
        if plain is None or bare == text
        else Function(text[: -len(bare)] + fact.name, fact.arguments)
    )


def term_of_symbol(symbol: clingo.Symbol) -> Term:
    """A clingo symbol as a term."""
    match symbol.type:
        case clingo.SymbolType.Number:
            return Number(symbol.number)
        case clingo.SymbolType.String:
            return Text(symbol.string)
        case clingo.SymbolType.Function:
            return Function(symbol.name, tuple(map(term_of_symbol, symbol.arguments)))
        case _:
            return Function(str(symbol))


def clingo_symbol(ground: Term) -> clingo.Symbol:
    """A ground term as a symbol of clingo."""
    match ground:
        case Number(value):
            return clingo.Number(value)
        case Text(value):
            return clingo.String(value)
        case Function(name, arguments):
            return clingo.Function(name, [clingo_symbol(argument) for argument in arguments])
        case _:
            raise TypeError(f"{ground} is not ground")


def ground_term(text: str) -> Term:
    """A ground term from its text, read in a fast way.

    Arithmetic in it is evaluated. Raises `AspError`.
    """
    plain = plain_terms(text)
    if plain is not None and len(plain) == 1 and is_ground(plain[0]):
        return plain[0]
    # few texts are not plain

    if (reason := find_unsafe_text(text)) is not None:
        raise AspError([(1, reason.offset + 1, reason.message)])
    messages = Messages()
    try:
        return term_of_symbol(clingo.parse_term(text, logger=messages))
    except UnicodeEncodeError as error:
        raise AspError([(1, error.start + 1, "half a character is no text")]) from None
    except RuntimeError as error:
        messages.hear(str(error))
        raise AspError(messages.heard) from None


MAX_ASP_NESTING = 50
MAX_ASP_OPERATIONS = 100
MAX_STATEMENT_PARTS = 10_000  # of one statement, between its commas and semicolons
MAX_ASP_INTEGER = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Why a text is not given to clingo, and the offset of the character that is the reason."""

    offset: int
    message: str
    hint: str
    code: str = "K202"


def find_unsafe_text(text: str, longest: int = 65_536) -> Suspicion | None:
    """The first thing in a text that is not safe to give to clingo; None for nearly every text."""
    if len(text) <= 1000 and _ORDINARY.fullmatch(text) and text.count("(") <= MAX_ASP_NESTING:
        return None
    if len(text) > longest:
        return Suspicion(
            0, f"longer than {longest} characters", "give long lists of facts in problems", "K007"
        )
    bare = _BLANKED.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    depth = operations = parts = 0
    for sign_match in _SUSPICIOUS.finditer(bare):
        sign = sign_match[0]
        depth += (sign in "([{") - (sign in ")]}")
        operations = 0 if sign in (",", ";", ".", "..") else operations + (sign in "-+*/\\~^?&|")
        parts = 0 if sign == "." else parts + (sign in ",;")
        if why := _refusal_reason(sign, depth, operations, parts):
            return Suspicion(sign_match.start(), *why)
    return None


_ORDINARY = re.compile(r"(?:[a-zA-Z_(), ]|[0-9](?![0-9]{8}))*")
_BLANKED = re.compile(r'%\*.*?\*%|%[^\n]*|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_SUSPICIOUS = re.compile(
    r"#\s*(?:include|script)\b|[0-9]{10,}|\.\.|[][(){},;.~^?&|*/\\+-]|[^\x01-\x7f]"
)


def _refusal_reason(sign: str, depth: int, operations: int, parts: int) -> tuple[str, ...] | None:
    if sign.endswith("script"):
        return "#script is not allowed: domain files are data", "express it as rules"
    if sign.startswith("#"):
        return (
            "#include is not part of the language",
            "list the file under `include:` in domain.yaml",
            "K203",
        )
    if not sign.isascii() or sign == "\0":
        return (
            f"unexpected '{sign}'" if sign != "\0" else "a NUL",
            "only texts and comments may hold it",
            "K201",
        )
    if sign.isdigit() and int(sign[:20]) > MAX_ASP_INTEGER:
        return "this number is too large", f"the largest is {MAX_ASP_INTEGER}", "K113"
    if depth > MAX_ASP_NESTING:
        return f"nested deeper than {MAX_ASP_NESTING} brackets", "no term needs so many", "K007"
    if operations > MAX_ASP_OPERATIONS:
        return (
            f"more than {MAX_ASP_OPERATIONS} operations in one term",
            "compute it beforehand",
            "K007",
        )
    if parts > MAX_STATEMENT_PARTS:
        return (
            f"more than {MAX_STATEMENT_PARTS} parts in one statement",
            "write several statements",
            "K007",
        )
    return None
