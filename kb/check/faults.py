"""Finds faults of a whole fault base, such as causes without an exception, a separating test or a repair."""

from collections.abc import Iterator

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.faults import FaultModel, Interruption

MOST_CAUSES = 1000


def check_faults(model: FaultModel) -> list[Diagnostic]:
    """Warnings about a fault base, and errors if it is too large for the selection of tests."""
    return [*_unraised(model), *_unrepaired(model), *_idle(model), *_alike(model), *_too_many(model)]


def _unraised(model: FaultModel) -> Iterator[Diagnostic]:
    raised = {cause for each in model.exceptions.values() for cause in each.counts}
    for cause in model.causes.values():
        if cause.name not in raised:
            hint = "name it under an exception, or remove it"
            yield Diagnostic(
                cause.where, "K309", f"no exception has the cause '{cause.name}'", hint, warning=True
            )


def _unrepaired(model: FaultModel) -> Iterator[Diagnostic]:
    for cause in model.causes.values():
        if not cause.stops and not model.repairs_of(cause.name):
            noted = ", if only one that notes it" if cause.adds or cause.denies or cause.loses else ""
            hint = f"give it a repair{noted}, or say `stops: true`: the cell then stops safely and asks"
            yield Diagnostic(cause.where, "K903", f"nothing repairs '{cause.name}'", hint, warning=True)


def _idle(model: FaultModel) -> Iterator[Diagnostic]:
    for test in model.tests.values():
        if not any(test in model.telling(each.counts) for each in model.exceptions.values()):
            hint = "name the causes under which its outcome differs"
            message = f"'{test.name}' tells no causes of any exception apart"
            yield Diagnostic(test.where, "K904", message, hint, warning=True)


def _alike(model: FaultModel) -> Iterator[Diagnostic]:
    """Warnings about classes of causes that no test separates and no single repair serves."""
    for exception in model.exceptions.values():
        for group in model.alike(exception.name):
            if not any(all(r.cures.get(cause) for cause in group) for r in model.repairs.values()):
                message = f"no test tells {' and '.join(group)} apart, and no repair serves them all"
                hint = "add a test that rules one of them out, or a repair for both"
                yield Diagnostic(exception.where, "K902", message, hint, warning=True)


def _too_many(model: FaultModel) -> Iterator[Diagnostic]:
    for exception in model.exceptions.values():
        yield from too_many(exception)


def too_many(exception: Interruption) -> Iterator[Diagnostic]:
    """An error if an exception has more causes than the selection of tests takes."""
    if len(exception.counts) > MOST_CAUSES:
        message = f"more than {MOST_CAUSES} causes of one exception"
        yield Diagnostic(exception.where, "K905", message, "split the exception by reply or operator")
