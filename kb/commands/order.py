"""The order that a sentence gives, as chains of stages.

The acts of one object follow each other in the order of the sentence, however they are joined. "then" between acts of different
objects is a barrier. An act that names no object of its own ("open the drawer") is a barrier, too, if the sentence has an order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from kb.model.conditions import And, Condition
from kb.model.problem import Chain
from kb.terms import Atom, Term, is_ground


@dataclass(frozen=True, slots=True)
class Act:
    """The condition that one clause asks for one subject.

    `stages` is None if the condition cannot be a stage. `must` means that the phrase makes the act an event or a stage.
    `alone` means that no slot names its subject. `then` means that the clause follows "then".
    """

    clause: int
    subject: Term
    condition: Condition
    stages: tuple[Atom, ...] | None
    must: bool
    alone: bool
    then: bool


class NoOrder(Exception):
    """A clause has a place in the order of its sentence, but its condition cannot be a stage."""

    def __init__(self, clause: int) -> None:
        super().__init__("no stage")
        self.clause = clause


def arrange(acts: Sequence[Act]) -> tuple[Condition, tuple[Chain, ...]]:
    """The goal and the chains for the acts of a sentence. Raises `NoOrder`."""
    ordered = _is_ordered(acts)
    groups = _groups(acts) if ordered else [list(acts)]
    placed = [act for act in acts if ordered and _has_place(act, acts, groups)]
    chains = _Chains()
    for group in groups:
        chains.add([act for act in group if act in placed])
    lasting = {act.subject: act for act in placed}.values()  # the last act of each subject
    goals = dict.fromkeys(
        act.condition for act in acts if act not in placed or (act in lasting and _is_open(act))
    )
    return And(tuple(goals)), chains.finished()


def _is_ordered(acts: Sequence[Act]) -> bool:
    subjects = [act.subject for act in acts]
    return any(act.must or act.then for act in acts) or len(set(subjects)) < len(subjects)


def _groups(acts: Sequence[Act]) -> list[list[Act]]:
    """The acts in groups. A new group begins at "then", and before and after an act that names no object of its own."""
    groups: list[list[Act]] = []
    for before, act in zip([None, *acts], acts, strict=False):
        same = before is not None and act.clause == before.clause
        apart = before is None or act.then or act.alone or before.alone
        if apart and not same:
            groups.append([])
        groups[-1].append(act)
    return groups


def _has_place(act: Act, acts: Sequence[Act], groups: Sequence[Sequence[Act]]) -> bool:
    """Whether an act is a stage: because of its phrase, because its subject has several acts, or beside a barrier."""
    several = sum(other.subject == act.subject for other in acts) > 1
    return act.must or several or len(groups) > 1


def _is_open(act: Act) -> bool:
    """Whether the last stage of an act contains `_`. Then it is also a goal, because a chain cannot keep it true."""
    return act.stages is not None and not is_ground(act.stages[-1])


class _Chains:
    """Segments of chains under construction. A segment for which another one waits is not extended."""

    def __init__(self) -> None:
        self.segments: dict[str, Chain] = {}
        self.latest: dict[Term, str] = {}
        self.sealed: set[str] = set()
        self.previous: set[Term] = set()

    def add(self, group: Sequence[Act]) -> None:
        """Append a group. Subjects that were not in the group before it wait for all earlier acts."""
        waits = tuple(self.latest.values())
        started: set[Term] = set()
        for act in group:
            if act.stages is None:
                raise NoOrder(act.clause)
            if act.subject not in started and act.subject not in self.previous:
                self._open(act.subject, waits)
            elif self.latest[act.subject] in self.sealed:
                self._open(act.subject, (self.latest[act.subject],))
            started.add(act.subject)
            name = self.latest[act.subject]
            segment = self.segments[name]
            self.segments[name] = replace(segment, stages=segment.stages + act.stages)
        if started:
            self.previous = started

    def _open(self, subject: Term, after: tuple[str, ...]) -> None:
        earlier = sum(segment.subject == subject for segment in self.segments.values())
        name = f"{subject}:{earlier + 1}" if earlier else str(subject)
        self.segments[name] = Chain(name, (), self._reduced(after), subject)
        self.sealed.update(after)
        self.latest[subject] = name

    def _reduced(self, after: tuple[str, ...]) -> tuple[str, ...]:
        """`after` without the segments for which another one in it already waits."""
        behind = {name for each in after for name in self._behind(each)}
        return tuple(name for name in after if name not in behind)

    def _behind(self, name: str) -> set[str]:
        direct = self.segments[name].after
        return set(direct).union(*(self._behind(each) for each in direct))

    def finished(self) -> tuple[Chain, ...]:
        """The chains, each after the chains that it waits for."""
        return tuple(self.segments.values())
