"""Our names as PDDL names of letters, digits, `-` and `_`; none is used twice."""

import re
from dataclasses import dataclass, field

from cellwright.kb.terms import Number, Term, Text, Variable

PDDL_WORDS = frozenset(
    [
        "and",
        "or",
        "not",
        "imply",
        "when",
        "forall",
        "exists",
        "either",
        "define",
        "domain",
        "problem",
        "object",
        "number",
        "increase",
        "total-cost",
        "minimize",
        "maximize",
        "total-time",
        "start",
        "end",
        "all",
        "over",
        "at-start",
    ]
)


@dataclass
class PddlNames:
    """A one-to-one mapping. Names that differ only in their kind get the kind as a suffix."""

    _given: dict[tuple[str, str], str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def of(self, kind: str, name: str) -> str:
        """The PDDL name of a type, predicate, object or action."""
        key = (kind, name)
        if key not in self._given:
            self._given[key] = self._fresh(kind, _plain_letters(name))
        return self._given[key]

    def term(self, term: Term) -> str:
        """The PDDL name of an object, which may be any term of our language."""
        match term:
            case Number(value):
                said = f"n{value}" if value >= 0 else f"minus{-value}"
                key = ("object", said)
            case Text(value):
                key = ("object", f"text {value}")
            case _:
                key = ("object", str(term))
        return self.of(*key)

    def _fresh(self, kind: str, plain: str) -> str:
        candidate, number = plain, 1
        while candidate in self._taken or candidate in PDDL_WORDS:
            number += 1
            candidate = f"{plain}-{kind}" if number == 2 else f"{plain}-{kind}-{number}"
        self._taken.add(candidate)
        return candidate


@dataclass
class Variables:
    """The variables of one action or axiom, with short names."""

    _given: dict[Variable, str] = field(default_factory=dict)

    def of(self, variable: Variable) -> str:
        """`?name`."""
        if variable not in self._given:
            plain = _plain_letters(re.sub(r"__\d+", "", variable.name))
            candidate, number, taken = f"?{plain}", 1, set(self._given.values())
            while candidate in taken:
                number += 1
                candidate = f"?{plain}-{number}"
            self._given[variable] = candidate
        return self._given[variable]


def _plain_letters(name: str) -> str:
    spelt = re.sub(r"[(,\s]+", "-", name.lower().replace(")", "").replace('"', ""))
    spelt = re.sub(r"[^a-z0-9_-]", "_", spelt).strip("_-")
    return spelt if re.match(r"[a-z]", spelt) else f"x{spelt}"
