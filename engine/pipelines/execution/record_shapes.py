"""Shapes of journal records: what each kind of record holds, checked where records are read.

Whoever reads a record behind this door may trust its keys and types, and that its texts are terms.
What a run cannot have written is told as `DamagedRecord`, so that no reader has to expect it. Keys
that are not named here are let through: other versions may have written them.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from cellwright.engine.model.run_protocol import (
    CommandKind,
    JournalRecord,
    RecordKind,
    RunPhase,
)
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.store.journal import JournalLine
from cellwright.kb.store.term_notation import NotationError, read_term
from cellwright.kb.terms import Function

MAX_COUNT = 10_000_000  # of steps, commands and records
MAX_TIME_MS = 2**62
Shape = Callable[[object], bool]


class DamagedRecord(Exception):
    """A record that no run writes. The text says which one, and what is wrong."""


def is_text(value: object) -> bool:
    """Any text."""
    return isinstance(value, str)


def is_flag(value: object) -> bool:
    """True or false."""
    return isinstance(value, bool)


def is_count(value: object) -> bool:
    """A number of a step, a command or a record, or how many there are."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_COUNT


def is_time(value: object) -> bool:
    """Milliseconds; forecasts and what is missing may be negative."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return whole and -MAX_TIME_MS <= value <= MAX_TIME_MS  # type: ignore[operator]


def is_number(value: object) -> bool:
    """A finite number."""
    real = isinstance(value, (int, float)) and not isinstance(value, bool)
    return real and math.isfinite(value) and abs(value) < MAX_TIME_MS  # type: ignore[arg-type]


def is_share(value: object) -> bool:
    """A finite number of 0 or more."""
    return is_number(value) and isinstance(value, (int, float)) and value >= 0


@lru_cache(1 << 14)
def _is_atom_text(text: str) -> bool:
    try:
        return isinstance(ground_term(text), Function)
    except AspError:
        return False


@lru_cache(1 << 12)
def _is_term_text(text: str) -> bool:
    try:
        ground_term(text)
    except AspError:
        return False
    return True


@lru_cache(1 << 12)
def _is_pattern_text(text: str) -> bool:
    try:
        read_term(text)
    except NotationError:
        return False
    return True


def is_atom(value: object) -> bool:
    """A step or a fact without variables."""
    return isinstance(value, str) and _is_atom_text(value)


def is_term(value: object) -> bool:
    """A term without variables."""
    return isinstance(value, str) and _is_term_text(value)


def is_pattern(value: object) -> bool:
    """A term that may have variables, as journals have it."""
    return isinstance(value, str) and _is_pattern_text(value)


def is_nothing(value: object) -> bool:
    """No value."""
    return value is None


def is_anything(value: object) -> bool:
    """Plain JSON that readers only show or hand on."""
    del value
    return True


def either(*shapes: Shape) -> Shape:
    """One of several shapes."""
    return lambda value: any(shape(value) for shape in shapes)


def one_of(*words: str) -> Shape:
    """One of these words."""
    return lambda value: isinstance(value, str) and value in words


def list_of(shape: Shape) -> Shape:
    """A list of values of one shape."""
    return lambda value: isinstance(value, list) and all(map(shape, value))


def map_of(shape: Shape) -> Shape:
    """An object whose values have one shape."""
    return lambda value: isinstance(value, dict) and all(map(shape, value.values()))


def row_of(*shapes: Shape, least: int | None = None) -> Shape:
    """A list with a value of each shape, in order; of the last ones some may be left out, but
    `least` are there.
    """
    fewest = len(shapes) if least is None else least

    def fits(value: object) -> bool:
        if not isinstance(value, list) or not fewest <= len(value) <= len(shapes):
            return False
        return all(shape(part) for shape, part in zip(shapes, value, strict=False))

    return fits


@dataclass(frozen=True, slots=True)
class ObjectShape:
    """An object with keys that it must have, and others that it may have."""

    needed: Mapping[str, Shape]
    possible: Mapping[str, Shape]

    def __call__(self, value: object) -> bool:
        """Whether a value has this shape."""
        return isinstance(value, dict) and next(self.misfits(value), None) is None

    def misfits(self, content: Mapping[str, object]) -> Iterator[str]:
        """The keys that are missing, or whose values have another shape."""
        yield from (key for key in self.needed if key not in content)
        for key, value in content.items():
            shape = self.needed.get(key) or self.possible.get(key)
            if shape is not None and not shape(value):
                yield key


def object_shape(needed: Mapping[str, Shape], **possible: Shape) -> ObjectShape:
    """An object with some keys, and others that may be left out."""
    return ObjectShape(needed, possible)


OPTIONAL_COUNT = either(is_nothing, is_count)
OPTIONAL_TIME = either(is_nothing, is_time)
TEXTS, ATOMS = list_of(is_text), list_of(is_atom)
MOVES = list_of(row_of(is_text, is_count, is_atom))
REASONS = list_of(row_of(is_text, is_text))
JOINTS = list_of(is_number)
ARMS = map_of(
    object_shape(
        {"q": list_of(is_number)},
        place=is_text,
        inside=is_flag,
        straight=list_of(list_of(is_number)),
    )
)
BODIES = map_of(either(is_nothing, map_of(is_anything)))
PLACEMENT = either(row_of(), row_of(*[is_number] * 12))
BEGINNING = {
    "target": is_text,
    "goals": is_text,
    "command": is_text,
    "driver": is_text,
    "seed": is_time,
    "factor": is_share,
    "options": map_of(is_text),
}
LAGS = list_of(row_of(is_count, is_time))
STEP = object_shape(
    {"id": is_count, "step": is_atom, "stream": is_text, "expects": is_pattern},
    says=is_text,
    after=list_of(is_count),
    resources=list_of(is_term),
    start_ms=is_time,
    lasts_ms=is_time,
    timeout_ms=OPTIONAL_TIME,
    longest_ms=OPTIONAL_TIME,
    rule=row_of(is_time, LAGS, LAGS, LAGS),
    result=is_pattern,
    asks=is_flag,
    rests=is_flag,
    process=is_flag,
    looks=TEXTS,
    watches=TEXTS,
    duration=is_time,
    cost=is_number,
    adds=ATOMS,
    ends=ATOMS,
    events=ATOMS,
)
DWELL = row_of(is_count, is_count, is_time, OPTIONAL_TIME, is_text, is_text, least=3)
PLAN_KEYS = {
    "why": is_text,
    "steps": list_of(STEP),
    "order": list_of(is_count),
    "dwells": list_of(DWELL),
    "timed": is_flag,
    "forecast_ms": is_time,
    "goals": TEXTS,
    "given_up": REASONS,
    "chains": map_of(is_count),
    "lost": TEXTS,
    "blocked": list_of(is_pattern),
}
PLAN_EXTRAS = {
    "hands": TEXTS,
    "wishes": ATOMS,
    "running": list_of(row_of(is_count, is_count)),
    "full": TEXTS,
    "ahead": list_of(row_of(is_count, is_time, is_time, is_time)),
    "pages": is_count,
    "whole": is_count,
}
# What a record says of a plan beside its steps: of the plan before a further command.
PLAN_HEAD = ObjectShape({}, {**PLAN_KEYS, **PLAN_EXTRAS})
COMMAND = object_shape(
    {
        "command": is_count,
        "command_kind": one_of(*CommandKind),
        "stream": is_text,
        "action": is_text,
        "says": is_text,
        "expects": is_text,
        "choices": TEXTS,
        "lasts_ms": is_time,
        "timeout_ms": OPTIONAL_TIME,
        "about": OPTIONAL_COUNT,
        "asks": is_flag,
        "step": OPTIONAL_COUNT,
    },
    looks=TEXTS,
    watches=TEXTS,
    part=PLACEMENT,
)
ALIGNMENT = object_shape(
    {"part": PLACEMENT, "wrong": TEXTS},
    centre=row_of(is_number, is_number, is_number),
    covariance=list_of(list_of(is_number)),
    datums=is_count,
    why=is_text,
    at_ms=is_time,
)
STATE = object_shape(
    {
        "facts": ATOMS,
        "reached": map_of(is_count),
        "plan": is_count,
        "done": list_of(row_of(is_count, is_count)),
        "ended": list_of(row_of(is_count, is_time)),
        "sent": list_of(row_of(COMMAND, is_time)),
        "number": is_count,
        "since": list_of(row_of(is_atom, is_time)),
        "before": is_count,
        "history": list_of(row_of(is_atom, ATOMS, MOVES)),
        "cases": list_of(row_of(is_text, is_text, is_count)),
        "forecast_ms": is_time,
        "exceptions": is_count,
        "steps": is_count,
        "additions": list_of(
            object_shape({"given": is_text, "wishes": ATOMS, "behind": PLAN_HEAD})
        ),
    },
    shares=list_of(is_number),
    unrested=TEXTS,
    met=BODIES,
    arms=ARMS,
    lying=ALIGNMENT,
)
PAGE = ObjectShape({"steps": list_of(STEP)}, {**PLAN_KEYS, **PLAN_EXTRAS})
VALUE = either(is_nothing, is_number)
VERDICT = object_shape(  # a result that is a value of a quantity
    {
        "of": is_text,
        "quantity": is_text,
        "unit": is_text,
        "tool": is_text,
        "value": is_number,
        "nominal": VALUE,
        "lower": VALUE,
        "upper": VALUE,
    },
    uncertainty=VALUE,
    risk=VALUE,
)
SHAPE_OF_RECORD: Mapping[RecordKind, ObjectShape] = {
    RecordKind.RUN: object_shape(
        BEGINNING, facts=ATOMS, times=list_of(row_of(is_atom, is_number)), motion=is_flag
    ),
    RecordKind.PLAN: ObjectShape(PLAN_KEYS, PLAN_EXTRAS),
    RecordKind.COMMAND: COMMAND,
    RecordKind.REPLY: object_shape(
        {"command": is_count, "text": is_text, "data": map_of(is_anything)}
    ),
    RecordKind.TROUBLE: object_shape({"trouble": is_text, "text": is_text}),
    RecordKind.DONE: object_shape(
        {
            "step": is_count,
            "command": is_count,
            "action": is_atom,
            "started_ms": is_time,
            "adds": ATOMS,
            "ends": ATOMS,
            "events": ATOMS,
            "moved": MOVES,
        },
        arms=ARMS,
    ),
    RecordKind.RESULT: object_shape(
        {"action": is_text},
        command=is_count,
        result=is_text,
        of=either(is_nothing, is_text),
    ),
    RecordKind.ALIGNMENT: ALIGNMENT,
    RecordKind.EXCEPTION: object_shape(
        {
            "exception": is_text,
            "step": OPTIONAL_COUNT,
            "action": is_atom,
            "command": OPTIONAL_COUNT,
            "reply": is_text,
        }
    ),
    RecordKind.FINDING: object_shape({"action": is_text, "outcome": is_text}),
    RecordKind.DIAGNOSIS: object_shape({"causes": list_of(row_of(is_text, is_number))}),
    RecordKind.WORLD: object_shape(
        {"why": is_text, "adds": ATOMS, "ends": ATOMS, "reached": map_of(is_count)},
        bodies=BODIES,
        spoils=REASONS,
    ),
    RecordKind.GIVEN_UP: object_shape({"goal": is_text, "why": is_text}),
    RecordKind.GOAL: object_shape({"goal": is_text}),
    RecordKind.ORDER: object_shape(
        {"order": is_text, "given": is_text, "origin": is_text}, who=is_text, when=is_text
    ),
    RecordKind.DECISION: object_shape(
        {"what": is_text, "why": is_text}, again=map_of(object_shape({"why": is_text}))
    ),
    RecordKind.PHASE: object_shape({"phase": one_of(*RunPhase), "why": is_text}),
    RecordKind.CHECKPOINT: object_shape({}, state=STATE, rest=PAGE),
    RecordKind.END: object_shape({"outcome": is_text, "why": is_text}),
}
BEGUN = object_shape(BEGINNING, problem=is_text, domain=is_text, motion=is_flag)


def record_kind(line: JournalLine) -> RecordKind:
    """The kind of a line. Raises `DamagedRecord` for one that is not known."""
    if not isinstance(line.kind, str) or line.kind not in tuple(RecordKind):
        raise DamagedRecord(f"line {line.number} is of an unknown kind: {str(line.kind)[:40]!r}")
    return RecordKind(line.kind)


def read_record(line: JournalLine) -> JournalRecord:
    """The record that a line of a journal holds. Raises `DamagedRecord` if no run writes it."""
    kind = record_kind(line)
    if not is_count(line.number) or not is_time(line.at_ms):
        raise DamagedRecord(f"line {line.number} ({kind}) has no time")
    _require_shape(SHAPE_OF_RECORD[kind], line.content, f"line {line.number} ({kind})")
    if kind is RecordKind.RESULT and line.content.get("of") is not None:
        _require_shape(VERDICT, line.content, f"line {line.number} ({kind})")
    if kind is RecordKind.PLAN:
        require_plan(line.content, f"line {line.number} ({kind})")
    return JournalRecord(line.number, line.at_ms, kind, line.content)


def require_beginning(document: Mapping[str, object]) -> None:
    """Raises `DamagedRecord` if a run cannot have been begun with this."""
    _require_shape(BEGUN, document, "what the run was begun with")


def _require_shape(shape: ObjectShape, content: Mapping[str, object], where: str) -> None:
    for key in shape.misfits(content):
        said = "is not as a run writes it" if key in content else "is missing"
        raise DamagedRecord(f"{where}: `{key}` {said}")


def require_plan(content: Mapping[str, object], where: str) -> None:
    """Raises `DamagedRecord` if this is no plan, or if a part of it refers to a step that is not
    there.
    """
    _require_shape(SHAPE_OF_RECORD[RecordKind.PLAN], content, where)
    steps: list[dict[str, list[int]]] = content["steps"]  # type: ignore[assignment]
    order: list[int] = content["order"]  # type: ignore[assignment]
    numbers = [step["id"] for step in steps]
    known = set[object](numbers)
    if len(known) != len(numbers) or set(order) - known or len(set(order)) != len(order):
        raise DamagedRecord(f"{where}: `order` does not fit the steps")
    if any(set(step.get("after", ())) - known for step in steps):
        raise DamagedRecord(f"{where}: a step waits for one that is not there")
    dwells: list[list[int]] = content["dwells"]  # type: ignore[assignment]
    if any(target not in known or source not in known | {0} for source, target, *_ in dwells):
        raise DamagedRecord(f"{where}: `dwells` names a step that is not there")
