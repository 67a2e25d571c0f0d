"""The reachable atoms of a problem, with their numbers, and tables of these numbers.

One `Universe` uses one grounder.
"""

from collections.abc import Iterable, Mapping

from cellwright.engine.model.task import Bits, indices
from cellwright.engine.stages.grounding.numbering import DERIVED
from cellwright.engine.stages.grounding.program import Vocabulary, numbered
from cellwright.kb.asp import Grounder
from cellwright.kb.asp.tables import Table
from cellwright.kb.terms import Atom, Function, Term


class Universe:
    """The atoms that can become true, ordered by number, and the terms in operator headers.

    `atoms` are the fluents. `derived` are the derived atoms; their numbers begin at `DERIVED`.
    """

    def __init__(self, grounder: Grounder, vocabulary: Vocabulary, invented: dict[str, int]) -> None:
        self._grounder = grounder
        self.atoms: list[Atom] = []
        self.derived: list[Atom] = []
        predicates = vocabulary.domain.predicates
        arities = {
            name: len(predicates[name].arguments) for name in predicates if vocabulary.is_dynamic(name)
        }
        for name, arity in {**arities, **invented}.items():
            found = grounder.atoms(f"_r_{name}", arity)
            part = self.derived if name in vocabulary.derived else self.atoms
            part.extend(sorted((Function(name, arguments) for arguments in found), key=str))
        self.index: dict[Atom, int] = {atom: number for number, atom in enumerate(self.atoms)}
        self.index.update((atom, DERIVED + number) for number, atom in enumerate(self.derived))
        facts = (f"{numbered_fact(atom, number)}." for atom, number in self.index.items())
        declared = (f"#defined _i_{name}/{arity + 1}." for name, arity in {**arities, **invented}.items())
        grounder.ground("\n".join((*declared, *facts)))
        self.terms: list[Term] = []
        self._derived = vocabulary.derived

    def facts(self, name: str, arity: int) -> list[tuple[Term, ...]]:
        """The arguments of every fact of a static predicate."""
        return self._grounder.atoms(name, arity)

    def derive(self, atom: Atom) -> int:
        """The number of one more derived atom."""
        self.derived.append(atom)
        return DERIVED + len(self.derived) - 1

    def atom(self, number: int) -> Atom:
        """The fluent or derived atom that has a number."""
        return self.derived[number - DERIVED] if number >= DERIVED else self.atoms[number]

    def names(self, bits: Bits) -> tuple[Atom, ...]:
        """The fluents in a bitset."""
        return tuple(self.atoms[number] for number in indices(bits))

    def is_derived(self, atom: Atom) -> bool:
        """Whether the atom's predicate is derived."""
        return atom.name in self._derived

    def name_terms(self, rules: Iterable[str]) -> None:
        """Numbers the terms that `rules` collect in `_arg`, as facts `_a(term, number)`."""
        self._grounder.ground("\n".join(rules))
        self.terms = [arguments[0] for arguments in self._grounder.atoms("_arg", 1)]
        self._grounder.ground("\n".join(f"_a({term},{number})." for number, term in enumerate(self.terms)))

    def tables(self, rules: dict[str, tuple[str, int]]) -> dict[str, Table]:
        """The rows of each predicate.

        `rules` has the text of its rules and its arity; they are grounded first.
        """
        self._grounder.ground("\n".join(text for text, _ in rules.values()))
        return self._grounder.tables({name: arity for name, (_, arity) in rules.items()})

    def number(self, rules: Iterable[str], arities: Mapping[str, int]) -> None:
        """Grounds rules and numbers the true atoms of each predicate p.

        The numbers are facts `p_number(arguments, number)`.
        """
        if not arities:
            return
        self._grounder.ground("\n".join(rules))
        facts = [f"#defined {name}_number/{arity + 1}." for name, arity in arities.items()]
        for name, arity in arities.items():
            for number, key in enumerate(sorted(self._grounder.atoms(name, arity), key=str)):
                facts.append(f"{name}_number({', '.join(map(str, (*key, number)))}).")
        self._grounder.ground("\n".join(facts))


def numbered_fact(atom: Atom, number: int) -> str:
    """The text of the fact `_i_p(arguments, number)` for a ground atom."""
    return (
        numbered(atom, "N").replace(", N)", f", {number})") if atom.arguments else f"_i_{atom.name}({number})"
    )
