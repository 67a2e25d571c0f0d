"""Orders the acts of a sentence in time, and makes a goal and chains of stages of them.

A stage that holds already costs nothing. So nothing would keep a plan from closing the drawer
before the heating, unless the drawer is open again, or still, when everything that is said between
the two acts is done.
"""

import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile

from cellwright.kb.commands.clauses import LINK_KINDS, Clause
from cellwright.kb.model.conditions import And, Condition, Literal
from cellwright.kb.model.planning_problem import Chain
from cellwright.kb.terms import Atom, Term, is_ground

Apart = Callable[[Literal, Literal], bool]
"""Whether two conditions cannot hold together, or whether the first cannot hold when the second
one becomes true.
"""

MOST_COMPARED = 100_000  # pairs of acts


@dataclass(frozen=True, slots=True)
class SentenceAct:
    """What one clause asks for one subject. `things` are the other objects that it names.

    `stages` is None if the condition cannot be a stage. `must` means that the phrase makes the act
    an event or a stage. `lasts` means that what it asks for is no event, so that another act can
    undo it. `alone` means that no slot names its subject. `then` means that the clause follows
    "then". `waits` are the conditions of other acts that it comes after.
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


def asked_again(acts: Sequence[SentenceAct], stays: Collection[str]) -> SentenceAct | None:
    """The first act of a clause that only asks again, later, for what stays once it is made:
    "measure m9, m1, then m9".

    `stays` are the predicates of such facts.
    """
    asked_before, before = set[tuple[Literal, ...]](), set[tuple[Literal, ...]]()
    for _, group in itertools.groupby(acts, key=lambda act: act.clause):
        own = list(group)
        asked = {act.literals for act in own}
        lasting = all(
            literal.atom.name in stays and literal.positive
            for literals in asked
            for literal in literals
        )
        if lasting and asked <= asked_before and (own[0].then or not asked <= before):
            return own[0]
        asked_before, before = asked_before | asked, asked
    return None


def undone_pairs(acts: Sequence[SentenceAct], apart: Apart, interrupted: Apart) -> Pairs:
    """Pairs of acts of different clauses of which the later one undoes the earlier one, or asks for
    the same again.

    They cannot hold together. Or "then" stands between them, and the later one cannot be done while
    the earlier one holds.
    """
    thens = list(itertools.accumulate(int(act.then) for act in acts))
    lasting = [number for number, act in enumerate(acts) if act.lasts]
    pairs: set[tuple[int, int]] = set()
    for first, second in itertools.islice(itertools.combinations(lasting, 2), MOST_COMPARED):
        earlier, later = acts[first], acts[second]
        if earlier.clause == later.clause or not _may_undo(acts, first, second):
            continue
        both = list(itertools.product(earlier.literals, later.literals))
        then = thens[second] > thens[first] or earlier.literals in later.waits
        then = then and not (earlier.must or later.must)
        if (
            any(apart(*pair) for pair in both)
            or (then and any(interrupted(*pair) for pair in both))
            or (earlier.literals == later.literals and second - first > 1 and not earlier.must)
        ):
            pairs.add((first, second))
    return frozenset(pairs)


def _may_undo(acts: Sequence[SentenceAct], first: int, second: int) -> bool:
    """Whether two acts may be a pair. A stage of a phrase follows the other acts of its object
    anyway.

    So it is in a pair with one of them only if a clause between the two is about other objects
    alone.
    """
    earlier, later = acts[first], acts[second]
    if not (earlier.must or later.must) or earlier.subject != later.subject:
        return True
    between = {act.clause for act in acts[first + 1 : second]} - {earlier.clause, later.clause}
    named = {
        act.clause
        for act in acts[first + 1 : second]
        if earlier.subject in (act.subject, *act.things)
    }
    return bool(between - named)


@dataclass(frozen=True, slots=True)
class Undoing:
    """The pairs of a sentence, and who answers what cannot hold together."""

    acts: Sequence[SentenceAct]
    pairs: Pairs
    apart: Apart
    interrupted: Apart

    def again(self, later: int, behind: Sequence[int]) -> tuple[Atom, ...]:
        """What an act undoes and what has to hold, again or still, when everything between the two
        acts is done.

        `behind` holds, for each act, all acts before it, as bits.
        """
        stages_again: dict[Atom, None] = {}
        for earlier in sorted(first for first, second in self.pairs if second == later):
            stages = self.acts[earlier].stages
            if stages is not None and any(self._lasts_through(earlier, later, behind)):
                stages_again |= dict.fromkeys(stages)
        return tuple(
            stage for stage in stages_again if stage not in (self.acts[later].stages or ())
        )

    def _lasts_through(self, earlier: int, later: int, behind: Sequence[int]) -> Iterator[bool]:
        """For each act between two, whether the earlier one can hold when it is done; nothing
        if another act undoes it before.
        """
        between = [
            n for n in range(earlier, later) if behind[n] >> earlier & 1 and behind[later] >> n & 1
        ]
        if not any((earlier, number) in self.pairs for number in between):
            yield from (self._together(self.acts[earlier], self.acts[number]) for number in between)

    def _together(self, earlier: SentenceAct, act: SentenceAct) -> bool:
        both = itertools.product(earlier.literals, act.literals)
        return not any(self.apart(*pair) or self.interrupted(*pair) for pair in both)


class NoOrder(Exception):
    """A clause has a place in the order of its sentence, but its condition cannot be a stage."""

    def __init__(self, clause: int) -> None:
        super().__init__("no stage")
        self.clause = clause


def arrange_acts(
    acts: Sequence[SentenceAct], apart: Apart, interrupted: Apart
) -> tuple[Condition, tuple[Chain, ...]]:
    """The goal and the chains for the acts of a sentence. Raises `NoOrder`."""
    pairs = undone_pairs(acts, apart, interrupted)
    acts = _join_undone_acts(acts, pairs)
    order = _Order()
    if _is_ordered(acts):
        barriers = {number for pair in pairs for number in pair} | {
            n for n, a in enumerate(acts) if a.alone
        }
        order.follow(acts, barriers, barriers - set(_explicitly_ordered(acts, pairs)))
    placed = {number for number, act in enumerate(acts) if act.must or number in order.related}
    placed -= {number for number in placed if _is_only_an_end(number, acts, order)}
    chains = _Chains(order, Undoing(acts, pairs, apart, interrupted))
    for number in sorted(placed):
        chains.add(number, acts[number])
    last = {
        n
        for n in placed
        if not any(order.waits(m, n) and acts[m].subject == acts[n].subject for m in placed)
    }
    ending = (act for n, act in enumerate(acts) if n not in placed or (n in last and _is_open(act)))
    return And(tuple(dict.fromkeys(act.condition for act in ending))), chains.finished()


def _join_undone_acts(acts: Sequence[SentenceAct], pairs: Pairs) -> list[SentenceAct]:
    """The acts, with one subject for those of which one undoes the other: the subject that was
    named first.
    """
    subjects: dict[Term, Term] = {}

    def first(subject: Term) -> Term:
        while subject in subjects:
            subject = subjects[subject]
        return subject

    for one, other in sorted(pairs):
        early, late = first(acts[one].subject), first(acts[other].subject)
        if early != late:
            subjects[late] = early
    return [
        replace(act, subject=first(act.subject), things=act.things | {act.subject}) for act in acts
    ]


def _is_ordered(acts: Sequence[SentenceAct]) -> bool:
    """Whether any act has a place in an order."""
    if any(act.must or act.then or act.waits for act in acts):
        return True
    clauses: dict[Term, int] = {}
    for act in acts:
        if clauses.setdefault(act.subject, act.clause) != act.clause:
            return True
    return any(clauses.get(thing, act.clause) != act.clause for act in acts for thing in act.things)


def _explicitly_ordered(acts: Sequence[SentenceAct], pairs: Pairs) -> Iterator[int]:
    """The acts of which the sentence says what they come after, beside an act that they undo."""
    for number, act in enumerate(acts):
        if act.waits - {acts[first].literals for first, second in pairs if second == number}:
            yield number


def _is_only_an_end(number: int, acts: Sequence[SentenceAct], order: "_Order") -> bool:
    """Whether an act that cannot be a stage is the only one of its subject and waits for
    others: then it holds at the end.
    """
    subject = acts[number].subject
    alone = all(act.subject != subject for n, act in enumerate(acts) if n != number)
    return acts[number].stages is None and number not in order.followed and alone


def _is_open(act: SentenceAct) -> bool:
    """Whether a stage of an act contains `_`.

    Then it is also a goal, because a chain cannot keep it true.
    """
    return act.stages is not None and not all(map(is_ground, act.stages))


@dataclass(slots=True)
class _Order:
    """Which acts wait for which.

    `direct` holds, for each act, the acts that it waits for and that no other implies.
    """

    direct: dict[int, list[int]] = field(default_factory=dict)
    behind: list[int] = field(default_factory=list)  # for each act, all acts before it, as bits
    # how many acts wait for each act directly
    followed: Counter[int] = field(default_factory=Counter)

    @property
    def related(self) -> set[int]:
        """The acts that wait or are waited for."""
        return {number for number, waits in self.direct.items() if waits} | {*self.followed}

    def waits(self, later: int, earlier: int) -> bool:
        """Whether an act comes after another one."""
        return later < len(self.behind) and bool(self.behind[later] >> earlier & 1)

    def follow(self, acts: Sequence[SentenceAct], barriers: set[int], late: set[int]) -> None:
        """Put acts in order. The acts of a clause never wait for each other.

        What stands behind one of `barriers` waits for it; one of `late` waits for everything before
        it.
        """
        waiting = _waiting_acts(acts)
        earlier: list[int] = []  # before the last "then": the acts that no other act waits for
        barrier: list[int] = []  # the acts of the last clause that everything behind it waits for
        for start, end in _clause_runs(acts):
            ends = [number for number in range(start) if number not in self.followed]
            earlier = ends if acts[start].then else earlier
            for number in range(start, end):
                waits = [*self._of_the_same(acts, number, start), *barrier]
                waits += [
                    preceding
                    for preceding in range(start)
                    if acts[preceding].literals in acts[number].waits
                ]
                waits += ends if number in late else earlier if number in waiting else []
                self._add(number, waits)
            if barriers & set(range(start, end)):
                barrier = [number for number in range(start, end) if number in barriers]

    def _of_the_same(self, acts: Sequence[SentenceAct], number: int, start: int) -> Iterator[int]:
        """The earlier acts of the subject, and those between which and this one a subject is
        named otherwise.
        """
        act = acts[number]
        for earlier in range(start):
            earlier_act = acts[earlier]
            if (
                earlier_act.subject == act.subject
                or earlier_act.subject in act.things
                or act.subject in earlier_act.things
            ):
                yield earlier

    def _add(self, number: int, waits: Sequence[int]) -> None:
        implied = bits = 0
        for predecessor in waits:
            implied |= self.behind[predecessor]
            bits |= 1 << predecessor
        self.behind.append(bits | implied)
        self.direct[number] = [
            awaited for awaited in sorted(set(waits)) if not implied >> awaited & 1
        ]
        self.followed.update(self.direct[number])


def _clause_runs(acts: Sequence[SentenceAct]) -> Iterator[tuple[int, int]]:
    """The first act of each clause and the first behind it."""
    start = 0
    for number in range(1, len(acts) + 1):
        if number == len(acts) or acts[number].clause != acts[start].clause:
            yield start, number
            start = number


def _waiting_acts(acts: Sequence[SentenceAct]) -> set[int]:
    """The acts that wait for everything before the last "then".

    If all objects of the group before "then" are named again behind it, each goes on by itself; any
    other object waits.
    """
    groups: list[list[int]] = [[]]
    for start, end in _clause_runs(acts):
        if acts[start].then and start:
            groups.append([])
        groups[-1].extend(range(start, end))
    waiting: set[int] = set()
    for before, group in itertools.pairwise(groups):
        previous, now = (
            {acts[number].subject for number in numbers} for numbers in (before, group)
        )
        going_on = previous if previous <= now else set()
        waiting.update(number for number in group if acts[number].subject not in going_on)
    return waiting


@dataclass(slots=True)
class _Chains:
    """Chains under construction. A chain for which another one waits is not extended."""

    order: _Order
    undoing: Undoing
    segments: dict[str, Chain] = field(default_factory=dict)
    # for each act, the chains that end with it
    ends: dict[int, list[str]] = field(default_factory=dict)

    def add(self, number: int, act: SentenceAct) -> None:
        """Append an act: to the chain of the only act that it waits for, or as chains of its
        own.
        """
        if act.stages is None:
            raise NoOrder(act.clause)
        waits = self.order.direct.get(number, [])
        again = self.undoing.again(number, self.order.behind) if waits else ()
        after = tuple(name for awaited in waits for name in self.ends[awaited])
        if len(after) == 1 and self._goes_on(waits[0], after[0], act):
            before = self.segments[after[0]]
            self.segments[after[0]] = replace(before, stages=before.stages + again + act.stages)
            self.ends[number] = [after[0]]
        elif act.must:
            self.ends[number] = [self._open(act.subject, again + act.stages, after)]
        else:
            self.ends[number] = [
                self._open(act.subject, (*again, stage), after) for stage in act.stages
            ]

    def _goes_on(self, earlier: int, name: str, act: SentenceAct) -> bool:
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


def in_order_of_time(
    clauses: Sequence[Clause], referred: Mapping[int, frozenset[int]]
) -> list[Clause]:
    """The clauses in the order in which they are to be done, each with those that it waits for
    (`waits`, by their offsets).

    `referred` says which linked clauses mean acts that were said before, and the offsets of those.
    They are left out.
    """
    in_time: list[Clause] = []
    rest = list(clauses)
    while rest:
        link = rest[0].link
        if not link:
            in_time.append(rest.pop(0))
            continue
        group = _take_group(rest)
        if link not in LINK_KINDS:
            in_time = _in_front(group, in_time, all_of=link == "first")
            continue
        forward = bool(rest) and (not in_time or _belongs_to(group[0], rest[0]))
        mains = _take_group(rest) if forward else in_time[-1:]
        in_time = _place_linked(in_time if forward else in_time[:-1], group, mains, referred)
    return in_time


def _take_group(rest: list[Clause]) -> list[Clause]:
    """The first clause and those behind it that go on with it, which are taken from the list."""
    link = rest[0].link if rest[0].link in LINK_KINDS else ""
    taken = [
        rest[0],
        *takewhile(lambda clause: clause.link == link if link else _goes_on(clause), rest[1:]),
    ]
    del rest[: len(taken)]
    return taken


def _goes_on(clause: Clause) -> bool:
    return not (clause.link or clause.then or clause.stop)


def _belongs_to(linked: Clause, following: Clause) -> bool:
    """Whether a linked clause behind others is about the clause that follows: ", after heating
    it, store it".
    """
    return linked.marked and _goes_on(following)


def _in_front(group: Sequence[Clause], clauses: Sequence[Clause], all_of: bool) -> list[Clause]:
    """The clauses with a group put before all of them, or before the last one."""
    cut = 0 if all_of else max(len(clauses) - 1, 0)
    before, behind = clauses[:cut], clauses[cut:]
    first = replace(group[0], then=bool(behind) and behind[0].then and cut > 0)
    waiting = [
        _wait_for(replace(clause, then=clause.then and n > 0), group)
        for n, clause in enumerate(behind)
    ]
    return [*before, first, *group[1:], *waiting]


def _place_linked(
    clauses: list[Clause],
    group: Sequence[Clause],
    mains: Sequence[Clause],
    referred: Mapping[int, frozenset[int]],
) -> list[Clause]:
    """The clauses with those of "after" or "before" and the acts that they belong to."""
    new = [clause for clause in group if clause.offset not in referred]
    if group[0].link == "after":
        return [
            *clauses,
            *_begun_as([*new, *(_wait_for(main, group) for main in mains)], group, mains),
        ]
    meant = frozenset[int]().union(*(referred.get(clause.offset, ()) for clause in group))
    cut = min(
        (n for n, clause in enumerate(clauses) if clause.offset in meant), default=len(clauses)
    )
    later = [
        _wait_for(clause, mains) if clause.offset in meant else clause for clause in clauses[cut:]
    ]
    own = _begun_as([*mains, *(_wait_for(clause, mains) for clause in new)], group, mains)
    return [*clauses[:cut], *own, *later]


def _begun_as(
    clauses: list[Clause], group: Sequence[Clause], mains: Sequence[Clause]
) -> list[Clause]:
    """The clauses, of which the first one follows "then" if the group or its act does."""
    then = any(own_group[0].then for own_group in (group, mains) if own_group)
    return [replace(clause, then=then and n == 0) for n, clause in enumerate(clauses)]


def _wait_for(clause: Clause, others: Iterable[Clause]) -> Clause:
    return replace(clause, waits=clause.waits | {awaited.offset for awaited in others})
