"""Facts that hold only while some action runs, and for how long: an action that needs one for
longer does not fit in.

A match gives light for 5 s, a kiln is hot for 8 s or for 20 s. What holds such a fact must fit
between the start that adds it and the end that deletes it. In relaxed plans the fact is split into
facts that say "for at least so long".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from cellwright.engine.model.temporal import GroundTimes, Span
from cellwright.engine.stages.temporal.formulas import constant


@dataclass(frozen=True)
class Windows:
    """For each fact that holds only while an action runs, a relaxed fact for each length; what
    each action gives.
    """

    lengths: Mapping[int, Mapping[Fraction, int]]
    givers: Mapping[int, tuple[int, ...]]
    count: int

    @classmethod
    def of(cls, task: GroundTimes, first: int) -> "Windows":
        """The windows of a problem; their relaxed facts are numbered from `first`."""
        given = _given(task)
        lengths: dict[int, dict[Fraction, int]] = {}
        number = first
        for fact, spans in sorted(given.items()):
            lengths[fact] = {}
            for length in sorted({length for _, length in spans}):
                lengths[fact][length] = number
                number += 1
        never = number
        givers: dict[int, list[int]] = {}
        for fact, spans in given.items():
            for action, own in spans:
                each = [relaxed for length, relaxed in lengths[fact].items() if length <= own]
                givers.setdefault(action, []).extend(each)
        lengths = {fact: {**each, Fraction(10**15): never} for fact, each in lengths.items()}
        rows = {action: tuple(row) for action, row in givers.items()}
        return cls(lengths, rows, number - first + 1)

    def needed(self, fact: int, span: Span) -> int:
        """The relaxed fact that an action needs where it holds a fact: one that lasts as long
        as the action.
        """
        lengths = self.lengths.get(fact)
        least = constant(span.shortest)
        if lengths is None or least is None:
            return fact
        return next(relaxed for length, relaxed in lengths.items() if length >= least)

    def gives(self, action: int) -> tuple[int, ...]:
        """The relaxed facts that hold while an action runs."""
        return self.givers.get(action, ())


def _given(task: GroundTimes) -> dict[int, list[tuple[int, Fraction]]]:
    """For each fact that holds only while actions run: these actions, with their longest
    durations.
    """
    others = {*task.initial, *(fact for timed in task.timed for fact in timed.happening.adds)}
    given: dict[int, list[tuple[int, Fraction]]] = {}
    for action, span in enumerate(task.spans):
        others.update(span.end.adds)
        length = constant(span.longest) if span.longest is not None else None
        ends = set(span.end.deletes) - set(span.end.adds)
        for fact in span.start.adds:
            if fact in ends and length is not None and not span.instantaneous:
                given.setdefault(fact, []).append((action, length))
            else:
                others.add(fact)
    return {fact: spans for fact, spans in given.items() if fact not in others}
