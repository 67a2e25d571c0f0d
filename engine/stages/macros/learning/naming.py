"""Names for the variables of a MACROP: those of the operators' headers, numbered as they occur in the body."""

from collections.abc import Iterable

from kb.terms import Term, Variable, variables


class FreshNames:
    """New names for variables, given in order of first use."""

    def __init__(self) -> None:
        self.names: dict[Variable, Variable] = {}
        self._counts: dict[str, int] = {}

    def number(self, terms: Iterable[tuple[Variable, Term]]) -> None:
        """Name what header variables stand for: `Arm1`, `Id1`, `Id2` after the first header variable of each."""
        for header, term in terms:
            if isinstance(term, Variable) and term not in self.names:
                base = _base(header)
                self._counts[base] = self._counts.get(base, 0) + 1
                self.names[term] = Variable(f"{base}{self._counts[base]}")

    def keep(self, terms: Iterable[Term]) -> None:
        """Name the remaining variables as they were, with a number where the name is taken."""
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
