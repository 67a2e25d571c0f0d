"""Which functions of a PDDL task have a value at the start, and for which objects."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import product

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope
from cellwright.engine.formats.interop.pddl.expressions import Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.numeric_functions import function_of


class StartValues:
    """The values in the facts of a problem whose objects are declared."""

    def __init__(self, facts: Sequence[Expression], scope: PddlScope) -> None:
        self.scope = scope
        self.given: dict[str, set[tuple[str, ...]]] = {}
        for part in facts:
            if isinstance(part, Group) and part.head == "=" and len(part.rest) == 2:
                function = function_of(part.rest[0])
                if function is not None:
                    named = tuple(each.text for each in function.rest if isinstance(each, PddlWord))
                    self.given.setdefault(function.head, set()).add(named)

    def partial(self, functions: Iterable[str]) -> set[str]:
        """Those of some functions that have no value for some objects of the declared types."""
        declared = [name for name in functions if name in self.scope.functions]
        return {name for name in declared if len(self.given.get(name, ())) < self.count(name)}

    def count(self, function: str) -> int:
        """For how many objects, or tuples of them, a function is declared; 1 for one that is
        not declared.
        """
        return (
            math.prod(map(len, self._extents(function))) if function in self.scope.functions else 1
        )

    def instances(self, function: str, wide: bool) -> Iterator[tuple[str, ...]]:
        """The objects for which a function may be read: those of its types, or, if it is read
        `wide`ly, all.
        """
        if wide:
            return product(self.scope.objects, repeat=len(self.scope.functions[function]))
        return product(*self._extents(function))

    def _extents(self, function: str) -> list[list[str]]:
        return [
            [name for name, own in self.scope.objects.items() if self.scope.is_subtype(own, type_)]
            for type_ in self.scope.functions[function]
        ]
