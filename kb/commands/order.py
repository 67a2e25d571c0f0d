"""The order that a sentence gives, as chains of stages.

The acts of one object follow each other in the order of the sentence, however they are joined; so do an act of an object and an
act that names it otherwise ("put probe 1 into box 2, close box 2"). "then" lets the acts behind it wait for those before it. An
act that names no object of its own ("open the drawer"), and one that a later act of its object undoes ("open box 2", "close
box 2"), stand between what is said before and behind them, if the sentence has an order.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.kb.commands.undoing import Act, Apart, Pairs, Undoing, undone
from cellwright.kb.model.conditions import And, Condition
from cellwright.kb.model.problem import Chain
from cellwright.kb.terms import Atom, Term, is_ground


class NoOrder(Exception):
    """A clause has a place in the order of its sentence, but its condition cannot be a stage."""

    def __init__(self, clause: int) -> None:
        super().__init__("no stage")
        self.clause = clause


def arrange(acts: Sequence[Act], apart: Apart, interrupted: Apart) -> tuple[Condition, tuple[Chain, ...]]:
    """The goal and the chains for the acts of a sentence. Raises `NoOrder`."""
    pairs = undone(acts, apart, interrupted)
    acts = _joined(acts, pairs)
    order = _Order()
    if _is_ordered(acts):
        barriers = {number for pair in pairs for number in pair} | {n for n, a in enumerate(acts) if a.alone}
        order.follow(acts, barriers, barriers - set(_told(acts, pairs)))
    placed = {number for number, act in enumerate(acts) if act.must or number in order.related}
    placed -= {number for number in placed if _is_only_an_end(number, acts, order)}
    chains = _Chains(order, Undoing(acts, pairs, apart, interrupted))
    for number in sorted(placed):
        chains.add(number, acts[number])
    last = {
        n for n in placed if not any(order.waits(m, n) and acts[m].subject == acts[n].subject for m in placed)
    }
    ending = (act for n, act in enumerate(acts) if n not in placed or (n in last and _is_open(act)))
    return And(tuple(dict.fromkeys(act.condition for act in ending))), chains.finished()


def _joined(acts: Sequence[Act], pairs: Pairs) -> list[Act]:
    """The acts, with one subject for those of which one undoes the other: the subject that was named first."""
    subjects: dict[Term, Term] = {}

    def first(subject: Term) -> Term:
        while subject in subjects:
            subject = subjects[subject]
        return subject

    for one, other in sorted(pairs):
        early, late = first(acts[one].subject), first(acts[other].subject)
        if early != late:
            subjects[late] = early
    return [replace(act, subject=first(act.subject), things=act.things | {act.subject}) for act in acts]


def _is_ordered(acts: Sequence[Act]) -> bool:
    """Whether any act has a place in an order."""
    if any(act.must or act.then or act.waits for act in acts):
        return True
    clauses: dict[Term, int] = {}
    for act in acts:
        if clauses.setdefault(act.subject, act.clause) != act.clause:
            return True
    return any(clauses.get(thing, act.clause) != act.clause for act in acts for thing in act.things)


def _told(acts: Sequence[Act], pairs: Pairs) -> Iterator[int]:
    """The acts of which the sentence says what they come after, beside an act that they undo."""
    for number, act in enumerate(acts):
        if act.waits - {acts[first].literals for first, second in pairs if second == number}:
            yield number


def _is_only_an_end(number: int, acts: Sequence[Act], order: "_Order") -> bool:
    """Whether an act that cannot be a stage is the only one of its subject and waits for others: then it holds at the end."""
    subject = acts[number].subject
    alone = all(act.subject != subject for n, act in enumerate(acts) if n != number)
    return acts[number].stages is None and number not in order.followed and alone


def _is_open(act: Act) -> bool:
    """Whether a stage of an act contains `_`. Then it is also a goal, because a chain cannot keep it true."""
    return act.stages is not None and not all(map(is_ground, act.stages))


@dataclass(slots=True)
class _Order:
    """Which acts wait for which. `direct` holds, for each act, the acts that it waits for and that no other implies."""

    direct: dict[int, list[int]] = field(default_factory=dict)
    behind: list[int] = field(default_factory=list)  # for each act, all acts before it, as bits
    followed: Counter[int] = field(default_factory=Counter)  # how many acts wait for each act directly

    @property
    def related(self) -> set[int]:
        """The acts that wait or are waited for."""
        return {number for number, waits in self.direct.items() if waits} | {*self.followed}

    def waits(self, later: int, earlier: int) -> bool:
        """Whether an act comes after another one."""
        return later < len(self.behind) and bool(self.behind[later] >> earlier & 1)

    def follow(self, acts: Sequence[Act], barriers: set[int], late: set[int]) -> None:
        """Put acts in order. The acts of a clause never wait for each other.

        What stands behind one of `barriers` waits for it; one of `late` waits for everything before it.
        """
        waiting = _waiting(acts)
        earlier: list[int] = []  # before the last "then": the acts that no other act waits for
        barrier: list[int] = []  # the acts of the last clause that everything behind it waits for
        for start, end in _runs(acts):
            ends = [number for number in range(start) if number not in self.followed]
            earlier = ends if acts[start].then else earlier
            for number in range(start, end):
                waits = [*self._of_the_same(acts, number, start), *barrier]
                waits += [each for each in range(start) if acts[each].literals in acts[number].waits]
                waits += ends if number in late else earlier if number in waiting else []
                self._add(number, waits)
            if barriers & set(range(start, end)):
                barrier = [number for number in range(start, end) if number in barriers]

    def _of_the_same(self, acts: Sequence[Act], number: int, start: int) -> Iterator[int]:
        """The earlier acts of the subject, and those between which and this one a subject is named otherwise."""
        act = acts[number]
        for earlier in range(start):
            other = acts[earlier]
            if other.subject == act.subject or other.subject in act.things or act.subject in other.things:
                yield earlier

    def _add(self, number: int, waits: Sequence[int]) -> None:
        implied = bits = 0
        for each in waits:
            implied |= self.behind[each]
            bits |= 1 << each
        self.behind.append(bits | implied)
        self.direct[number] = [each for each in sorted(set(waits)) if not implied >> each & 1]
        self.followed.update(self.direct[number])


def _runs(acts: Sequence[Act]) -> Iterator[tuple[int, int]]:
    """The first act of each clause and the first behind it."""
    start = 0
    for number in range(1, len(acts) + 1):
        if number == len(acts) or acts[number].clause != acts[start].clause:
            yield start, number
            start = number


def _waiting(acts: Sequence[Act]) -> set[int]:
    """The acts that wait for everything before the last "then".

    If all objects of the group before "then" are named again behind it, each goes on by itself; any other object waits.
    """
    groups: list[list[int]] = [[]]
    for start, end in _runs(acts):
        if acts[start].then and start:
            groups.append([])
        groups[-1].extend(range(start, end))
    found: set[int] = set()
    for before, group in itertools.pairwise(groups):
        previous, now = ({acts[number].subject for number in each} for each in (before, group))
        going_on = previous if previous <= now else set()
        found.update(number for number in group if acts[number].subject not in going_on)
    return found


@dataclass(slots=True)
class _Chains:
    """Chains under construction. A chain for which another one waits is not extended."""

    order: _Order
    undoing: Undoing
    segments: dict[str, Chain] = field(default_factory=dict)
    ends: dict[int, list[str]] = field(default_factory=dict)  # for each act, the chains that end with it

    def add(self, number: int, act: Act) -> None:
        """Append an act: to the chain of the only act that it waits for, or as chains of its own."""
        if act.stages is None:
            raise NoOrder(act.clause)
        waits = self.order.direct.get(number, [])
        again = self.undoing.again(number, self.order.behind) if waits else ()
        after = tuple(name for each in waits for name in self.ends[each])
        if len(after) == 1 and self._goes_on(waits[0], after[0], act):
            before = self.segments[after[0]]
            self.segments[after[0]] = replace(before, stages=before.stages + again + act.stages)
            self.ends[number] = [after[0]]
        elif act.must:
            self.ends[number] = [self._open(act.subject, again + act.stages, after)]
        else:
            self.ends[number] = [self._open(act.subject, (*again, stage), after) for stage in act.stages]

    def _goes_on(self, earlier: int, name: str, act: Act) -> bool:
        return (
            self.order.followed[earlier] == 1
            and self.segments[name].subject == act.subject
            and (act.must or len(act.stages or ()) == 1)
        )

    def _open(self, subject: Term, stages: tuple[Atom, ...], after: tuple[str, ...]) -> str:
        earlier = sum(segment.subject == subject for segment in self.segments.values())
        name = f"{subject}:{earlier + 1}" if earlier else str(subject)
        self.segments[name] = Chain(name, stages, after, subject)
        return name

    def finished(self) -> tuple[Chain, ...]:
        """The chains, each after the chains that it waits for."""
        return tuple(self.segments.values())
