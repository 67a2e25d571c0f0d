"""PDDL names as ASP names and back. ASP names have no hyphens and begin with a small letter; each is used once."""

import re
from dataclasses import dataclass, field

from cellwright.kb.terms import Variable

RESERVED = {"not", "object", "int", "time", "text"}


@dataclass
class NameMapping:
    """A one-to-one mapping per kind of name. Types and predicates share one, because ASP does not distinguish them."""

    _given: dict[tuple[str, str], str] = field(default_factory=dict)
    _taken: dict[tuple[str, str], str] = field(default_factory=dict)

    def of(self, kind: str, name: str) -> str:
        """The ASP name of a PDDL name; `kind` is predicate, type, object, operator or variable."""
        given = self._given.get((kind, name))
        if given is None:
            given = self._given[(kind, name)] = self._fresh(kind, name)
        return given

    def variable(self, name: str) -> Variable:
        """The variable of `?name`."""
        return Variable(self.of("variable", name.removeprefix("?")))

    def original(self, kind: str, name: str) -> str:
        """The PDDL name of an ASP name, or the name itself if there is none."""
        return self._taken.get((_space(kind), name), name)

    def _fresh(self, kind: str, name: str) -> str:
        plain = re.sub(r"[^a-z0-9_]", "_", name.lower()).lstrip("_")
        plain = plain if re.match(r"[a-z]", plain) else f"n{plain}"
        if kind == "variable":
            plain = plain[0].upper() + plain[1:]
        candidate, number = plain, 2
        while candidate in RESERVED or (_space(kind), candidate) in self._taken:
            candidate, number = f"{plain}_{number}", number + 1
        self._taken[(_space(kind), candidate)] = name
        return candidate


def _space(kind: str) -> str:
    return "predicate" if kind == "type" else kind
