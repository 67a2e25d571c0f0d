"""The order that a sentence gives, as chains of stages.

The acts of one object follow each other as said, however they are joined. "then" between acts of different objects is a
barrier, and so is an act that names no object of its own ("open the drawer") in a sentence that has an order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from kb.model.conditions import And, Condition
from kb.model.problem import Chain
from kb.terms import Atom, Term, is_ground


@dataclass(frozen=True, slots=True)
class Act:
    """What one clause asks of one subject.

    `stages` are None when the condition cannot be a stage; `must` says that the act is an event or a stage by its
    phrase; `alone` that no slot names its subject; `then` that the clause follows "then".
    """

    clause: int
    subject: Term
    condition: Condition
    stages: tuple[Atom, ...] | None
    must: bool
    alone: bool
    then: bool


class NoOrder(Exception):
    """A clause has a place in the order of its sentence, but is nothing that can be a stage."""

    def __init__(self, clause: int) -> None:
        super().__init__("no stage")
        self.clause = clause


def arrange(acts: Sequence[Act]) -> tuple[Condition, tuple[Chain, ...]]:
    """The goal and the chains of a sentence's acts. Raises `NoOrder`."""
    ordered = _is_ordered(acts)
    groups = _groups(acts) if ordered else [list(acts)]
    placed = [act for act in acts if ordered and _has_place(act, acts, groups)]
    chains = _Chains()
    for group in groups:
        chains.add([act for act in group if act in placed])
    lasting = {act.subject: act for act in placed}.values()  # the last of each subject
    goals = dict.fromkeys(
        act.condition for act in acts if act not in placed or (act in lasting and _is_open(act))
    )
    return And(tuple(goals)), chains.finished()


def _is_ordered(acts: Sequence[Act]) -> bool:
    subjects = [act.subject for act in acts]
    return any(act.must or act.then for act in acts) or len(set(subjects)) < len(subjects)


def _groups(acts: Sequence[Act]) -> list[list[Act]]:
    """The acts between barriers: at "then", and around an act that stands alone."""
    groups: list[list[Act]] = []
    for before, act in zip([None, *acts], acts, strict=False):
        same = before is not None and act.clause == before.clause
        apart = before is None or act.then or act.alone or before.alone
        if apart and not same:
            groups.append([])
        groups[-1].append(act)
    return groups


def _has_place(act: Act, acts: Sequence[Act], groups: Sequence[Sequence[Act]]) -> bool:
    """Whether an act is a stage: one by its phrase, one of several of its subject, or one beside a barrier."""
    several = sum(other.subject == act.subject for other in acts) > 1
    return act.must or several or len(groups) > 1


def _is_open(act: Act) -> bool:
    """Whether the act's last stage leaves something open (`_`): then it is a goal as well, since a chain cannot keep it."""
    return act.stages is not None and not is_ground(act.stages[-1])


class _Chains:
    """Segments of chains under construction; a segment that another one waits for grows no more."""

    def __init__(self) -> None:
        self.segments: dict[str, Chain] = {}
        self.latest: dict[Term, str] = {}
        self.sealed: set[str] = set()
        self.previous: set[Term] = set()

    def add(self, group: Sequence[Act]) -> None:
        """Append a group; subjects that were not in the group before it wait for all that has been said."""
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
        """Those of `after` that no other of them waits for already."""
        behind = {name for each in after for name in self._behind(each)}
        return tuple(name for name in after if name not in behind)

    def _behind(self, name: str) -> set[str]:
        direct = self.segments[name].after
        return set(direct).union(*(self._behind(each) for each in direct))

    def finished(self) -> tuple[Chain, ...]:
        """The chains, each after those that it waits for."""
        return tuple(self.segments.values())
