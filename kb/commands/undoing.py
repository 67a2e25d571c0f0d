"""Which acts of a sentence a later one undoes, and what holds again before it does: "open the drawer, heat it, close the drawer".

A stage that holds already costs nothing. So nothing would keep a plan from closing the drawer before the heating, unless the
drawer is open again, or still, when everything that is said between the two acts is done.
"""

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.model.conditions import Condition, Literal
from cellwright.kb.terms import Atom, Term

Apart = Callable[[Literal, Literal], bool]
"""Whether two conditions cannot hold together, or whether the first cannot hold when the second one becomes true."""

MOST_COMPARED = 100_000  # pairs of acts


@dataclass(frozen=True, slots=True)
class Act:
    """What one clause asks for one subject. `things` are the other objects that it names.

    `stages` is None if the condition cannot be a stage. `must` means that the phrase makes the act an event or a stage.
    `lasts` means that what it asks for is no event, so that another act can undo it. `alone` means that no slot names its
    subject. `then` means that the clause follows "then". `waits` are the conditions of other acts that it comes after.
    """

    clause: int
    subject: Term
    things: frozenset[Term]
    literals: tuple[Literal, ...]
    condition: Condition
    stages: tuple[Atom, ...] | None
    must: bool
    lasts: bool
    alone: bool
    then: bool
    waits: frozenset[tuple[Literal, ...]] = frozenset()


Pairs = frozenset[tuple[int, int]]


def asked_again(acts: Sequence[Act], stays: Collection[str]) -> Act | None:
    """The first act of a clause that only asks again, later, for what stays once it is made: "measure m9, m1, then m9".

    `stays` are the predicates of such facts.
    """
    made, before = set[tuple[Literal, ...]](), set[tuple[Literal, ...]]()
    for _, group in itertools.groupby(acts, key=lambda act: act.clause):
        own = list(group)
        asked = {act.literals for act in own}
        lasting = all(each.atom.name in stays and each.positive for literals in asked for each in literals)
        if lasting and asked <= made and (own[0].then or not asked <= before):
            return own[0]
        made, before = made | asked, asked
    return None


def undone(acts: Sequence[Act], apart: Apart, interrupted: Apart) -> Pairs:
    """Pairs of acts of different clauses of which the later one undoes the earlier one, or asks for the same again.

    They cannot hold together. Or "then" stands between them, and the later one cannot be done while the earlier one holds.
    """
    thens = list(itertools.accumulate(int(act.then) for act in acts))
    lasting = [number for number, act in enumerate(acts) if act.lasts]
    found: set[tuple[int, int]] = set()
    for first, second in itertools.islice(itertools.combinations(lasting, 2), MOST_COMPARED):
        one, other = acts[first], acts[second]
        if one.clause == other.clause or not _may_undo(acts, first, second):
            continue
        both = list(itertools.product(one.literals, other.literals))
        then = thens[second] > thens[first] or one.literals in other.waits
        then = then and not (one.must or other.must)
        if (
            any(apart(*each) for each in both)
            or (then and any(interrupted(*each) for each in both))
            or (one.literals == other.literals and second - first > 1 and not one.must)
        ):
            found.add((first, second))
    return frozenset(found)


def _may_undo(acts: Sequence[Act], first: int, second: int) -> bool:
    """Whether two acts may be a pair. A stage of a phrase follows the other acts of its object anyway.

    So it is in a pair with one of them only if a clause between the two is about other objects alone.
    """
    one, other = acts[first], acts[second]
    if not (one.must or other.must) or one.subject != other.subject:
        return True
    between = {act.clause for act in acts[first + 1 : second]} - {one.clause, other.clause}
    named = {act.clause for act in acts[first + 1 : second] if one.subject in (act.subject, *act.things)}
    return bool(between - named)


@dataclass(frozen=True, slots=True)
class Undoing:
    """The pairs of a sentence, and who answers what cannot hold together."""

    acts: Sequence[Act]
    pairs: Pairs
    apart: Apart
    interrupted: Apart

    def again(self, later: int, behind: Sequence[int]) -> tuple[Atom, ...]:
        """What an act undoes and what has to hold, again or still, when everything between the two acts is done.

        `behind` holds, for each act, all acts before it, as bits.
        """
        found: dict[Atom, None] = {}
        for earlier in sorted(first for first, second in self.pairs if second == later):
            stages = self.acts[earlier].stages
            if stages is not None and any(self._lasts_through(earlier, later, behind)):
                found |= dict.fromkeys(stages)
        return tuple(each for each in found if each not in (self.acts[later].stages or ()))

    def _lasts_through(self, earlier: int, later: int, behind: Sequence[int]) -> Iterator[bool]:
        """For each act between two, whether the earlier one can hold when it is done; nothing if another act undoes it before."""
        between = [n for n in range(earlier, later) if behind[n] >> earlier & 1 and behind[later] >> n & 1]
        if not any((earlier, number) in self.pairs for number in between):
            yield from (self._together(self.acts[earlier], self.acts[number]) for number in between)

    def _together(self, earlier: Act, act: Act) -> bool:
        both = itertools.product(earlier.literals, act.literals)
        return not any(self.apart(*each) or self.interrupted(*each) for each in both)
