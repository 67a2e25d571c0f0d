"""What follows by a rule when one of its conditions has just become possible: the other conditions, in an order decided once.

The checker's own, like the rest of its Datalog.
"""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

from engine.stages.validation.datalog import Bindings, in_order, solutions
from engine.stages.validation.facts import Facts
from kb.model.conditions import Body, Literal
from kb.model.domain import Rule
from kb.terms import Atom, match, substitute_atom, variables


@dataclass(frozen=True, slots=True)
class Join:
    """One condition of a rule and the other ones. `older` are those of the others that come before it in the rule and can change.

    If one of these is new as well, the same instance is found there.
    """

    rule: Rule
    condition: Atom
    others: Body
    older: Sequence[Atom]

    def bindings(self, fresh: Sequence[Atom], new: Container[Atom], facts: Facts) -> Iterator[Bindings]:
        """The bindings of the whole body in which the condition is one of some fresh atoms; `new` are all that are fresh."""
        for atom in fresh:
            first = match(self.condition, atom, {})
            if first is None:
                continue
            for found in solutions(self.others, facts, first):
                if not any(substitute_atom(each, found) in new for each in self.older):
                    yield found


def join(rule: Rule, body: Body, place: int, changing: Sequence[int]) -> Join:
    """The join of a rule from the condition at a place of its body, one of the places of positive literals that can change."""
    atoms = {each: part.atom for each in changing if isinstance(part := body[each], Literal)}
    rest = body[:place] + body[place + 1 :]
    older = [atom for each, atom in atoms.items() if each < place]
    return Join(rule, atoms[place], in_order(rest, variables(atoms[place])), older)
