"""Which of the quantities that one PDDL action changes may be one and the same, for equal
arguments.

`(decrease (n ?a) 1) (increase (n ?b) 1)` changes two quantities, or one of them twice if ?a and ?b
are the same object. In PDDL 2.1 increases and decreases add up; an assignment bears no other change
of its quantity (Fox & Long 2003, section 3).
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

from cellwright.kb.terms import Function, Term, Variable

Blocks = tuple[tuple[Function, ...], ...]  # the quantities in one block are the same one
MAX_CASES = 200  # ways in which the quantities of one action may coincide
MAX_TRIALS = 5000


class TooManyCases(Exception):
    """The quantities of an action may coincide in too many ways."""


def coincidences(
    quantities: Sequence[Function], may_be_same: Callable[[Function, Function], bool]
) -> list[Blocks]:
    """All ways in which quantities may be the same, first that all differ.

    Raises `TooManyCases`.
    """
    possible: list[Blocks] = []
    for trial, blocks in enumerate(_partitions(tuple(quantities), may_be_same)):
        if _is_consistent(blocks):
            possible.append(blocks)
        if len(possible) > MAX_CASES or trial > MAX_TRIALS:
            raise TooManyCases
    return possible


def _partitions(
    quantities: tuple[Function, ...], may_be_same: Callable[[Function, Function], bool]
) -> Iterator[Blocks]:
    """The partitions into blocks of quantities that may be the same."""
    if not quantities:
        yield ()
        return
    *before, last = quantities
    for blocks in _partitions(tuple(before), may_be_same):
        yield (*blocks, (last,))
    for blocks in _partitions(tuple(before), may_be_same):
        for place, block in enumerate(blocks):
            if all(one.name == last.name and may_be_same(one, last) for one in block):
                yield (*blocks[:place], (*block, last), *blocks[place + 1 :])


def _is_consistent(blocks: Blocks) -> bool:
    """Whether some arguments make exactly the quantities of each block the same."""
    leaders: dict[Term, Term] = {}

    def leader(term: Term) -> Term:
        while term in leaders:
            term = leaders[term]
        return term

    for block in blocks:
        for other in block[1:]:
            for pair in zip(block[0].arguments, other.arguments, strict=True):
                one, two = sorted(map(leader, pair), key=lambda term: isinstance(term, Variable))
                if one == two:
                    continue
                if not isinstance(two, Variable):
                    return False  # two different objects
                leaders[two] = one
    firsts = [(block[0].name, tuple(map(leader, block[0].arguments))) for block in blocks]
    return all(one != other for one, other in combinations(firsts, 2))
