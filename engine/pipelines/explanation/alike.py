"""Objects that a problem tells apart by name alone: what does not help for one of them does not help for the others.

Two objects may only be alike together with others: a tube, and the seat where it belongs. So what changes places is found
from two objects on, and then proved: every fact stays true.
"""

import itertools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

from cellwright.engine.model.explanation import Edit
from cellwright.engine.pipelines.explanation.amendments import subterms
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, exchanged

MOST = 2_000_000  # facts times pairs of objects; above this nothing is looked for
IMAGES = 500  # of one edit
HERE = Function("*")  # stands for the object that is looked at

Swap = Mapping[Term, Term]


class Alike:
    """Which edits of a problem are the same but for the names of alike objects."""

    def __init__(self, space: Space) -> None:
        problem, domain = space.problem, space.problem.domain
        said = (domain.operators, domain.deductive_operators, domain.defaults, domain.rules)
        texts = [
            repr(said),
            repr(problem.goal),
            repr((domain.quantities, problem.durations)),
            *map(str, (s for c in problem.chains for s in c.stages)),
        ]
        named = set(re.findall(r"[a-z]\w*", "\n".join([*texts, *(each.text for each in domain.asp)])))
        types = {**domain.objects, **problem.objects}
        self.types = {Function(name): type_ for name, type_ in types.items() if name not in named}
        self.facts = frozenset((*problem.statics, *problem.initial))
        self.about: dict[Term, list[Atom]] = defaultdict(list)
        for fact in sorted(self.facts, key=str):
            for each in self._things(fact):
                self.about[each].append(fact)
        self.swaps = tuple(self._swaps())

    def images(self, edit: Edit) -> set[Edit]:
        """The edits that alike objects make of one, itself included."""
        found, waiting = {edit}, [edit]
        while waiting and len(found) < IMAGES:
            last = waiting.pop()
            new = {_exchanged(last, swap) for swap in self.swaps} - found
            found |= new
            waiting += new
        return found

    def _things(self, fact: Term) -> dict[Function, None]:
        """The objects in a fact that nothing but facts names."""
        inner = (each for each in subterms(fact) if isinstance(each, Function))
        return dict.fromkeys(each for each in inner if each in self.types)

    def _swaps(self) -> Iterator[Swap]:
        """What changes places with what, for neighbours among objects of which the same is said."""
        groups: dict[tuple[object, ...], list[Function]] = defaultdict(list)
        for each in sorted(self.types, key=str):
            groups[self.types[each], *sorted(self._shapes(each))].append(each)
        pairs = [pair for group in groups.values() for pair in itertools.pairwise(group)]
        if len(pairs) * len(self.facts) <= MOST:
            for one, other in pairs:
                if (swap := self._completed({one: other, other: one})) is not None:
                    yield swap

    def _shapes(self, thing: Function) -> Iterator[str]:
        """What is said of an object, without names of others."""
        for fact in self.about[thing]:
            hidden: dict[Term, Term] = {
                each: HERE if each == thing else ANYTHING for each in self._things(fact)
            }
            yield str(exchanged(fact, hidden))

    def _completed(self, swap: dict[Term, Term]) -> Swap | None:
        """A swap with all that has to change places, too, so that every fact stays true; None if it cannot be."""
        waiting = list(swap)
        while waiting:
            for fact in self.about[waiting.pop()]:
                if exchanged(fact, swap) not in self.facts:
                    more = self._repair(fact, swap)
                    if more is None:
                        return None
                    swap |= more
                    waiting += more
        return swap if all(exchanged(each, swap) in self.facts for each in self._touched(swap)) else None

    def _repair(self, fact: Atom, swap: Swap) -> dict[Term, Term] | None:
        """The one pair of objects that has to change places, too, so that what a swap makes of a fact is true."""
        free = [each for each in self._things(fact) if each not in swap]
        image = exchanged(fact, swap)
        if len(free) != 1:
            return None
        pattern = exchanged(image, {free[0]: HERE})
        near = next(each for each in self._things(image) if each in swap)
        fitting = [
            thing
            for other in self.about[near]
            for thing in self._things(other)
            if thing not in swap and self.types[thing] == self.types[free[0]]
            if exchanged(other, {thing: HERE}) == pattern
        ]
        return {free[0]: fitting[0], fitting[0]: free[0]} if len(fitting) == 1 else None

    def _touched(self, swap: Swap) -> Iterable[Atom]:
        return dict.fromkeys(fact for each in swap for fact in self.about[each])


def _exchanged(edit: Edit, swap: Swap) -> Edit:
    added, removed = (None if each is None else exchanged(each, swap) for each in (edit.added, edit.removed))
    assert isinstance(added, Function | None)
    assert isinstance(removed, Function | None)
    return Edit(edit.layer, added, removed)
