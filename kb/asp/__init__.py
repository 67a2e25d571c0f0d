"""The only way to clingo: grounding definite programs, and reading ASP files statement by statement.

Programs that are grounded here are stratified, so the grounder evaluates them and no solver runs. Large
results leave as tables of integers, through one theory atom for each table. clingo writes its text in C++,
which is about six times faster than asking for symbols one by one.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping

import clingo

from cellwright.kb.asp.bounded import run_bounded
from cellwright.kb.asp.tables import Table, table
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import Function, Number, Term, Text, is_ground


class AspError(Exception):
    """clingo refused a program. `messages` are (line, column, text); lines of that text count from 1."""

    def __init__(self, messages: Iterable[tuple[int, int, str]]) -> None:
        self.messages = list(messages)
        super().__init__("; ".join(text for _, _, text in self.messages))


class Messages:
    """Collects clingo's messages; they are not printed."""

    _PLACE = re.compile(r"<?[\w-]*>?:(\d+):(\d+)(?:-[\d:]+)?: (?:error|info|warning): (.*)", re.DOTALL)

    def __init__(self) -> None:
        self.heard: list[tuple[int, int, str]] = []

    def __call__(self, _code: clingo.MessageCode, text: str) -> None:
        self.hear(text)

    def hear(self, text: str) -> None:
        """Stores a message, with its place in the text as line and column."""
        found = self._PLACE.match(text)
        line, column, said = (int(found[1]), int(found[2]), found[3]) if found else (0, 0, text)
        self.heard.append((line, column, " ".join(said.split())))


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
        """Take all true atoms of some predicates as they are given: that is quicker than to ask clingo for each.

        They must be what clingo would say, also after further text is grounded.
        """
        self._given = given

    def ground(self, text: str) -> None:
        """Adds statements, and everything that follows from them.

        Raises `AspError`, and what `cellwright.kb.asp.bounded` raises where that takes too long.
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
        known = self._given.get((predicate, arity))
        return known.keys() if known is not None else self._true(predicate, arity)

    def _true(self, predicate: str, arity: int, positive: bool = True) -> list[Function]:
        """Every true atom of a predicate, read from clingo once: planner and checker ask for the same ones."""
        key = predicate, arity, positive
        if key not in self._read:
            found = self._control.symbolic_atoms.by_signature(predicate, arity, positive)
            self._read[key] = [_fact(atom.symbol) for atom in found]
        return self._read[key]

    def column(self, predicate: str, arity: int, number: int) -> list[str]:
        """The texts of one argument of every true atom of a predicate: its other arguments are not read."""
        found = self._control.symbolic_atoms.by_signature(predicate, arity)
        return [str(atom.symbol.arguments[number]) for atom in found]

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
        known = self._given.get((atom.name, len(atom.arguments)))
        if known is not None:
            return atom in known
        return self._control.symbolic_atoms[symbol(atom)] is not None

    def tables(self, arities: Mapping[str, int]) -> dict[str, Table]:
        """For each predicate over integers, its true atoms as sorted rows."""
        first = self._tables
        columns = {name: arity for name, arity in arities.items() if arity}
        statements = []
        for number, (name, arity) in enumerate(columns.items(), first):
            row = ",".join(f"X{index}" for index in range(arity))
            statements.append(f"&rows({number}) {{ {row} : {name}({row}) }}.")
        self._tables += len(columns)
        self.ground("\n".join(statements))
        found = {name: Table([[]] * len(self.atoms(name, 0))) for name in arities if name not in columns}
        names = list(columns)
        for atom in self._control.theory_atoms:
            number = atom.term.arguments[0].number - first
            if number >= 0:
                found[names[number]] = table(str(atom), columns[names[number]])
        return found


def _fact(symbol: clingo.Symbol) -> Function:
    """An atom. Most are read from their text, which clingo writes in less time than it gives arguments one by one."""
    text = str(symbol)
    bare = text.lstrip("_")  # what grounding invents has names with a bar in front, which is no plain name
    plain = plain_terms(bare)
    found = plain[0] if plain is not None else term(symbol)
    assert isinstance(found, Function)
    return (
        found if plain is None or bare == text else Function(text[: -len(bare)] + found.name, found.arguments)
    )


def term(symbol: clingo.Symbol) -> Term:
    """A clingo symbol as a term."""
    match symbol.type:
        case clingo.SymbolType.Number:
            return Number(symbol.number)
        case clingo.SymbolType.String:
            return Text(symbol.string)
        case clingo.SymbolType.Function:
            return Function(symbol.name, tuple(map(term, symbol.arguments)))
        case _:
            return Function(str(symbol))


def symbol(ground: Term) -> clingo.Symbol:
    """A ground term as a symbol of clingo."""
    match ground:
        case Number(value):
            return clingo.Number(value)
        case Text(value):
            return clingo.String(value)
        case Function(name, arguments):
            return clingo.Function(name, [symbol(each) for each in arguments])
        case _:
            raise TypeError(f"{ground} is not ground")


def ground_term(text: str) -> Term:
    """A ground term from its text, read in a fast way. Arithmetic in it is evaluated. Raises `AspError`."""
    plain = plain_terms(text)
    if plain is not None and len(plain) == 1 and is_ground(plain[0]):
        return plain[0]
    from cellwright.kb.asp.suspicion import suspicion  # few texts are not plain

    if (found := suspicion(text)) is not None:
        raise AspError([(1, found.offset + 1, found.message)])
    messages = Messages()
    try:
        return term(clingo.parse_term(text, logger=messages))
    except UnicodeEncodeError as error:
        raise AspError([(1, error.start + 1, "half a character is no text")]) from None
    except RuntimeError as error:
        messages.hear(str(error))
        raise AspError(messages.heard) from None
