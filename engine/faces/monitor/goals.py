"""Which goals a fact meets, as the journal names both: `measured(_, _, meas(m1))` is met by `measured(arm, slra, meas(m1))`."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from cellwright.kb.store.notation import NotationError, read_atom
from cellwright.kb.terms import ANYTHING, Function, Term

Mask = tuple[bool, ...]  # for each argument whether the goal says what it is


@dataclass(frozen=True, slots=True)
class GoalIndex:
    """Goals that are single facts, by predicate and by the arguments that they name. Other goals are in no index."""

    masks: dict[str, dict[Mask, dict[tuple[Term, ...], str]]] = field(default_factory=dict)
    general: set[str] = field(default_factory=set)  # those that several facts can meet

    @classmethod
    def of(cls, goals: Iterable[str]) -> "GoalIndex":
        """The index of some goals."""
        made = cls()
        for goal in goals:
            if (atom := _fact(goal)) is not None:
                mask = tuple(each != ANYTHING for each in atom.arguments)
                made.general.update([] if all(mask) else [goal])
                made.masks.setdefault(atom.name, {}).setdefault(mask, {})[_named(atom, mask)] = goal
        return made

    def met_by(self, fact: str) -> list[str]:
        """The goals that a fact meets."""
        masks = self.masks.get(fact.partition("(")[0])
        atom = _fact(fact) if masks else None
        if masks is None or atom is None:
            return []
        fitting = (mask for mask in masks if len(mask) == len(atom.arguments))
        found = (masks[mask].get(_named(atom, mask)) for mask in fitting)
        return [each for each in found if each is not None]


def _fact(text: str) -> Function | None:
    try:
        return read_atom(text)
    except NotationError:
        return None


def _named(atom: Function, mask: Mask) -> tuple[Term, ...]:
    return tuple(each for each, said in zip(atom.arguments, mask, strict=True) if said)
