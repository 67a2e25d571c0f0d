"""Patterns that are matched against terms with variables of their own."""

from dataclasses import dataclass, field

from cellwright.kb.terms import ANYTHING, Function, Term, Variable, is_ground


@dataclass
class Equations:
    """A pattern matched against terms with variables of their own.

    `bindings` belong to the variables of the pattern. `open` holds the equations that depend on the other variables.
    """

    bindings: dict[Variable, Term] = field(default_factory=dict)
    open: list[tuple[Term, Term]] = field(default_factory=list)

    def add(self, pattern: Term, value: Term) -> bool:
        """Add an equation; False if it can never hold."""
        match pattern, value:
            case _ if pattern == ANYTHING or value == ANYTHING:
                return True
            case Variable(), _ if pattern not in self.bindings:
                self.bindings[pattern] = value
                return True
            case Variable(), _:
                return self._equal(self.bindings[pattern], value)
            case Function(name, parts), Function(other, values) if parts or values:
                same = name == other and len(parts) == len(values)
                return same and all([self.add(*pair) for pair in zip(parts, values, strict=True)])
            case _:
                return self._equal(pattern, value)

    def _equal(self, one: Term, other: Term) -> bool:
        if one != other:
            if is_ground(one) and is_ground(other):
                return False
            self.open.append((one, other))
        return True
