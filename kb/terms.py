"""Terms and atoms: constants, numbers, texts, variables and compound terms, with substitution,
matching and unification.

An atom is a `Function` whose name is a predicate. `str` gives ASP text, for clingo and for people.
This module knows no types and no predicates.
"""

import functools
import operator
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import repeat


@dataclass(frozen=True, slots=True)
class Number:
    """An integer. Durations are numbers, in the domain's unit of time."""

    value: int

    def __str__(self) -> str:
        return str(self.value)


@dataclass(frozen=True, slots=True)
class Text:
    """A quoted string."""

    value: str

    def __str__(self) -> str:
        escaped = self.value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """A variable. `_` is anonymous: each of its occurrences stands for anything.

    There is one object for each name, so that variables are compared and hashed without a call:
    they are keys wherever terms are bound.
    """

    name: str

    def __new__(cls, name: str) -> "Variable":
        """The variable of that name."""
        return _VARIABLES.get(name) or _VARIABLES.setdefault(name, object.__new__(cls))

    def __reduce__(self) -> tuple[type, tuple[str]]:
        """By its name, which is the same variable again."""
        return Variable, (self.name,)

    def __str__(self) -> str:
        return self.name


_VARIABLES: dict[str, Variable] = {}

# the forms of terms: a value, ground with arithmetic inside, with variables
PLAIN, COMPUTED, OPEN = 0, 1, 2


class _Known:
    """Places for what is computed once: the hash and the form. They are no part of the value."""

    __slots__ = ("_form", "_hash")
    _hash: int | None
    _form: int | None


@dataclass(frozen=True, slots=True, init=False, eq=False)
class Function(_Known):
    """A constant (no arguments), a compound term, or an atom.

    Its hash is computed once: terms are looked up far more often than they are made. Making,
    hashing and comparing are written out, because planning does each of them millions of times.
    """

    name: str
    arguments: tuple["Term", ...] = ()

    def __init__(self, name: str, arguments: tuple["Term", ...] = ()) -> None:
        """A frozen value, so its fields are set past its own `__setattr__`."""
        _set_name(self, name)
        _set_arguments(self, arguments)
        _set_hash(self, None)
        _set_form(self, None if arguments else PLAIN)

    def __hash__(self) -> int:
        cached = self._hash
        if cached is None:
            cached = hash((self.name, self.arguments))
            _set_hash(self, cached)
        return cached

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Function):
            return NotImplemented
        return self.name == other.name and self.arguments == other.arguments

    def __reduce__(self) -> tuple[type, tuple[str, tuple["Term", ...]]]:
        """Without the hash, which is another one in another process."""
        return Function, (self.name, self.arguments)

    def __str__(self) -> str:
        if not self.arguments:
            return self.name
        if self.name == TOGETHER_SIGN:
            return " & ".join(map(str, self.arguments))
        return f"{self.name}({', '.join(map(str, self.arguments))})"


_set_name, _set_arguments = (
    vars(Function)[attribute].__set__ for attribute in ("name", "arguments")
)
_set_hash, _set_form = (vars(_Known)[attribute].__set__ for attribute in ("_hash", "_form"))


@dataclass(frozen=True, slots=True)
class Operation:
    """Arithmetic inside a constraint, such as `W1 + 2`. It is never part of a stored atom."""

    operator: str
    left: "Term"
    right: "Term"

    def __str__(self) -> str:
        return f"({self.left}{self.operator}{self.right})"


TOGETHER_SIGN = "&"  # the name of a stage of several fluents, which are its arguments


Term = Number | Text | Variable | Function | Operation
Atom = Function
Substitution = Mapping[Variable, Term]

ANYTHING = Variable("_")


def join_stage(atoms: Iterable[Atom]) -> Atom:
    """The stage that several fluents reach together: `stored(tube) & capped(tube)`."""
    return Function(TOGETHER_SIGN, tuple(atoms))


def stage_parts(stage: Atom) -> tuple[Atom, ...]:
    """The atoms of a stage: the stage itself, or those that are reached together."""
    if stage.name != TOGETHER_SIGN:
        return (stage,)
    return tuple(part for part in stage.arguments if isinstance(part, Function))


def term_variables(term: Term) -> Iterator[Variable]:
    """The variables of `term` in order of occurrence, as often as they occur, with `_`."""
    match term:
        case Variable():
            yield term
        case Function(_, arguments):
            for argument in arguments:
                yield from term_variables(argument)
        case Operation(_, left, right):
            yield from term_variables(left)
            yield from term_variables(right)
        case _:
            return


def term_form(term: Term) -> int:
    """PLAIN for a value, COMPUTED for a ground term with arithmetic inside, OPEN for a term
    with variables.
    """
    if isinstance(term, Function):
        form = term._form
        if form is None:
            form = max(map(term_form, term.arguments))
            _set_form(term, form)
        return form
    if isinstance(term, Operation):
        return max(COMPUTED, term_form(term.left), term_form(term.right))
    return OPEN if isinstance(term, Variable) else PLAIN


def is_ground(term: Term) -> bool:
    """Whether `term` has no variable."""
    return term_form(term) != OPEN


def substitute_term(term: Term, bindings: Substitution) -> Term:
    """`term` with every bound variable replaced.

    Variables inside the new terms are not replaced again.
    """
    if isinstance(term, Variable):
        return bindings.get(term, term)
    if isinstance(term, Function):
        return term if term._form == PLAIN else substitute_atom(term, bindings)
    if isinstance(term, Operation):
        return Operation(
            term.operator,
            substitute_term(term.left, bindings),
            substitute_term(term.right, bindings),
        )
    return term


def substitute_atom(atom: Atom, bindings: Substitution) -> Atom:
    """`substitute` for an atom. The result is an atom, too: the same one if nothing is replaced.

    Planning does this millions of times, so the common cases are written out.
    """
    form = atom._form
    if not bindings or (form if form is not None else term_form(atom)) != OPEN:
        return atom
    replaced: list[Term] = []
    for argument in atom.arguments:
        if isinstance(argument, Variable):
            replaced.append(bindings.get(argument, argument))
        elif isinstance(argument, Function):
            replaced.append(
                argument if argument._form == PLAIN else substitute_atom(argument, bindings)
            )
        else:
            replaced.append(substitute_term(argument, bindings))
    return (
        atom
        if all(map(operator.is_, replaced, atom.arguments))
        else Function(atom.name, tuple(replaced))
    )


def exchange_subterms(term: Term, others: Mapping[Term, Term]) -> Term:
    """`term` with other terms in the places of some, at any depth.

    What is put in is not looked at again.
    """
    if term in others:
        return others[term]
    if isinstance(term, Function) and term.arguments:
        return Function(
            term.name, tuple(exchange_subterms(argument, others) for argument in term.arguments)
        )
    return term


def match_term(pattern: Term, ground: Term, bindings: Substitution) -> dict[Variable, Term] | None:
    """The smallest extension of `bindings` under which `pattern` equals `ground`, or None; `_`
    matches anything.
    """
    extended = dict(bindings)
    return extended if _extend_match(pattern, ground, extended) else None


def _extend_match(pattern: Term, ground: Term, extended: dict[Variable, Term]) -> bool:
    """Whether the two match.

    The new bindings are added to `extended`; if they do not match, some may have been added.
    """
    if isinstance(pattern, Variable):
        if pattern.name == "_":
            return True
        return extended.setdefault(pattern, ground) == ground
    if is_ground(pattern):
        return pattern == ground
    if (
        not isinstance(pattern, Function)
        or not isinstance(ground, Function)
        or ground.name != pattern.name
        or len(ground.arguments) != len(pattern.arguments)
    ):
        return pattern == ground
    return all(map(_extend_match, pattern.arguments, ground.arguments, repeat(extended)))


def unify(left: Term, right: Term, bindings: Substitution) -> dict[Variable, Term] | None:
    """A most general unifier of two terms that extends `bindings`, or None.

    Robinson 1965, without the occurs check: terms of the domain language do not recurse, so a
    variable never meets a term that contains it. Bindings are triangular: follow them with
    `resolve`.
    """
    left, right = resolve_term(left, bindings), resolve_term(right, bindings)
    if left == right:
        return dict(bindings)
    if isinstance(left, Variable):
        return {**bindings, left: right}
    if isinstance(right, Variable):
        return {**bindings, right: left}
    if not isinstance(left, Function) or not isinstance(right, Function):
        return None
    if left.name != right.name or len(left.arguments) != len(right.arguments):
        return None
    unified: dict[Variable, Term] | None = dict(bindings)
    for one, other in zip(left.arguments, right.arguments, strict=True):
        if unified is None:
            return None
        unified = unify(one, other, unified)
    return unified


def resolve_term(term: Term, bindings: Substitution) -> Term:
    """`term` with variables replaced through chains of bindings until nothing changes."""
    while isinstance(term, Variable) and term in bindings:
        term = bindings[term]
    if isinstance(term, Function) and term.arguments:
        return Function(
            term.name, tuple(resolve_term(argument, bindings) for argument in term.arguments)
        )
    return term


@functools.cache
def _natural_pieces(text: str) -> tuple[tuple[int, int, str], ...]:
    pieces = re.findall(r"\d+|\D+", text)
    return tuple((0, int(piece), "") if piece.isdigit() else (1, 0, piece) for piece in pieces)


def natural_key(term: Term) -> tuple[tuple[int, int, str], ...]:
    """A sort key under which `m2` comes before `m10`."""
    return _natural_pieces(str(term))


def sort_naturally(terms: Iterable[Atom]) -> tuple[Atom, ...]:
    """The distinct terms in natural order, for output that must repeat."""
    return tuple(sorted(set(terms), key=natural_key))
