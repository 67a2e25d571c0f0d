"""The order in time of clauses that are said in another order: "store it after heating it", "..., but first open the drawer"."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile

from cellwright.kb.commands.clauses import LINKED, Clause


def in_order_of_time(clauses: Sequence[Clause], referred: Mapping[int, frozenset[int]]) -> list[Clause]:
    """The clauses in the order in which they are to be done, each with those that it waits for (`waits`, by their offsets).

    `referred` says which linked clauses mean acts that were said before, and the offsets of those. They are left out.
    """
    found: list[Clause] = []
    rest = list(clauses)
    while rest:
        link = rest[0].link
        if not link:
            found.append(rest.pop(0))
            continue
        group = _taken(rest)
        if link not in LINKED:
            found = _in_front(group, found, all_of=link == "first")
            continue
        forward = bool(rest) and (not found or _belongs_to(group[0], rest[0]))
        mains = _taken(rest) if forward else found[-1:]
        found = _linked(found if forward else found[:-1], group, mains, referred)
    return found


def _taken(rest: list[Clause]) -> list[Clause]:
    """The first clause and those behind it that go on with it, which are taken from the list."""
    link = rest[0].link if rest[0].link in LINKED else ""
    taken = [rest[0], *takewhile(lambda each: each.link == link if link else _goes_on(each), rest[1:])]
    del rest[: len(taken)]
    return taken


def _goes_on(clause: Clause) -> bool:
    return not (clause.link or clause.then or clause.stop)


def _belongs_to(linked: Clause, following: Clause) -> bool:
    """Whether a linked clause behind others is about the clause that follows: ", after heating it, store it"."""
    return linked.marked and _goes_on(following)


def _in_front(group: Sequence[Clause], found: Sequence[Clause], all_of: bool) -> list[Clause]:
    """The clauses with a group put before all of them, or before the last one."""
    cut = 0 if all_of else max(len(found) - 1, 0)
    before, behind = found[:cut], found[cut:]
    first = replace(group[0], then=bool(behind) and behind[0].then and cut > 0)
    waiting = [_waiting(replace(each, then=each.then and n > 0), group) for n, each in enumerate(behind)]
    return [*before, first, *group[1:], *waiting]


def _linked(
    found: list[Clause],
    group: Sequence[Clause],
    mains: Sequence[Clause],
    referred: Mapping[int, frozenset[int]],
) -> list[Clause]:
    """The clauses with those of "after" or "before" and the acts that they belong to."""
    new = [clause for clause in group if clause.offset not in referred]
    if group[0].link == "after":
        return [*found, *_begun_as([*new, *(_waiting(main, group) for main in mains)], group, mains)]
    meant = frozenset[int]().union(*(referred.get(clause.offset, ()) for clause in group))
    cut = min((n for n, each in enumerate(found) if each.offset in meant), default=len(found))
    later = [_waiting(each, mains) if each.offset in meant else each for each in found[cut:]]
    own = _begun_as([*mains, *(_waiting(each, mains) for each in new)], group, mains)
    return [*found[:cut], *own, *later]


def _begun_as(clauses: list[Clause], group: Sequence[Clause], mains: Sequence[Clause]) -> list[Clause]:
    """The clauses, of which the first one follows "then" if the group or its act does."""
    then = any(each[0].then for each in (group, mains) if each)
    return [replace(each, then=then and n == 0) for n, each in enumerate(clauses)]


def _waiting(clause: Clause, others: Iterable[Clause]) -> Clause:
    return replace(clause, waits=clause.waits | {each.offset for each in others})
