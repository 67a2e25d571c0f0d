"""Writes something of every kind into a library, and says what of it is there."""

import time
from collections.abc import Callable, Iterator

from cellwright.kb.model.plan_model import Macrop, MacroStep, StepId
from cellwright.kb.store import Library, Record, Use
from cellwright.kb.store.case_store import Cases, ClosedCase
from cellwright.kb.store.inspection_store import PlannedVisit, PoseStore, SequencePlan, Sequences
from cellwright.kb.store.journal import Journal, JournalLine
from cellwright.kb.terms import Function

DOMAIN = "cell"


def write(
    target: str, number: int, rounds: int, label: str, tell: Callable[[str], None], size: int = 300
) -> None:
    """Write so many rounds of everything; `tell` hears a mark after each commit. `size` is
    about the characters of a document.
    """
    name = f"{label}_{number}_{time.monotonic_ns()}"
    with (
        Library(target) as library,
        Cases(target) as cases,
        Sequences(target) as sequences,
        PoseStore(target) as poses,
        Journal(target) as journal,
    ):
        journal.begin(name, "2026-11-23", {"target": name})
        for each in range(1, rounds + 1):
            mark = f"{name}_{each}"
            added = library.add([_record(f"go_{mark}", size)])
            library.note_uses({int(added[0] or 0): Use(1, 0.1)})
            tell(f"macrop go_{mark}")
            cases.add([ClosedCase(DOMAIN, mark, ("slipped",), 1.0, (("look", "x" * size),))])
            tell(f"case {mark}")
            sequences.keep(
                SequencePlan(DOMAIN, mark, rest=(PlannedVisit("m1", "probe", (1.0, float(each))),))
            )
            tell(f"sequence {mark}")
            poses.keep(
                DOMAIN, "shared", {("m1", "probe", "s"): '{"at": 1}', ("m2", "probe", "s"): "{}"}
            )
            journal.append(
                name,
                [
                    JournalLine(2 * each - 1, each, "sent", {"text": "x" * size}),
                    JournalLine(2 * each, each, "done", {}),
                ],
            )
            tell(f"line {name} {2 * each}")


def _record(name: str, size: int) -> Record:
    steps = tuple(
        MacroStep(StepId(each), Function(f"act{each}")) for each in range(1, 2 + size // 100)
    )
    depends = {"operator act": "a1", f"operator {name[-6:]}": "b2"}
    made = Macrop(Function(name), DOMAIN, (), (), (), (), (), (), (), (), steps, (), (), depends)
    return Record(made, "go/0", 1.0, (("goal\ngo", 1),))


def content(target: str) -> set[str]:
    """The marks of all that is in a library."""
    return set(_marks(target))


def _marks(target: str) -> Iterator[str]:
    with Library(target) as library, Cases(target) as cases, Journal(target) as journal:
        yield from (f"macrop {each.macrop.name}" for each in library.all())
        yield from (f"case {each.exception}" for each in cases.history(DOMAIN))
        with Sequences(target) as sequences:
            for each in cases.history(DOMAIN):
                if sequences.of(DOMAIN, each.exception) is not None:
                    yield f"sequence {each.exception}"
        for run in journal.begun():
            yield from (
                f"line {run.run} {each.number}"
                for each in journal.lines(run.run)
                if each.number % 2 == 0
            )


def missing(target: str, told: list[str]) -> list[str]:
    """The marks of what was committed and is not there."""
    return sorted(set(told) - content(target))


def alone(target: str, number: str) -> None:
    """Write until there is no room any more, and print the marks; the last line tells of the
    error.
    """
    try:
        write(target, int(number), 400, f"w{number}", lambda said: print(said, flush=True))
    except Exception as error:
        print(f"error {type(error).__name__}: {str(error)[:200]!r}")
