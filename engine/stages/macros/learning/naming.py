"""Names for the variables of a MACROP: those in the operators' headers, numbered in the order of the body."""

from collections.abc import Iterable

from cellwright.kb.terms import Term, Variable, variables


class FreshNames:
    """New names for variables, given in order of first use."""

    def __init__(self) -> None:
        self.names: dict[Variable, Variable] = {}
        self._counts: dict[str, int] = {}

    def number(self, terms: Iterable[tuple[Variable, Term]]) -> None:
        """Name the terms of header variables, each after its first header variable: `Arm1`, `Id1`, `Id2`."""
        for header, term in terms:
            if isinstance(term, Variable) and term not in self.names:
                base = _base(header)
                self._counts[base] = self._counts.get(base, 0) + 1
                self.names[term] = Variable(f"{base}{self._counts[base]}")

    def keep(self, terms: Iterable[Term]) -> None:
        """Keep the names of the remaining variables; add a number if a name is already used."""
        for term in terms:
            for variable in variables(term):
                if variable not in self.names:
                    self.names[variable] = self._free(_base(variable))

    def _free(self, base: str) -> Variable:
        taken = {each.name for each in self.names.values()}
        name, number = base, 1
        while name in taken:
            number += 1
            name = f"{base}_{number}"
        return Variable(name)


def _base(variable: Variable) -> str:
    return variable.name.split("@")[0].rstrip("_") or "X"
