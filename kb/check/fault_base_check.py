"""Warnings about a fault base: causes without exception, separating test or repair."""

from collections.abc import Iterator

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.fault_model import FaultModel, Interruption

MAX_EXCEPTION_CAUSES = 1000


def check_faults(model: FaultModel) -> list[Diagnostic]:
    """Warnings about a fault base, and errors if it is too large for the selection of tests."""
    return [
        *_unraised_causes(model),
        *_unrepaired_causes(model),
        *_idle_tests(model),
        *_inseparable_causes(model),
        *_too_many(model),
    ]


def _unraised_causes(model: FaultModel) -> Iterator[Diagnostic]:
    raised = {cause for exception in model.exceptions.values() for cause in exception.counts}
    for cause in model.causes.values():
        if cause.name not in raised:
            hint = "name it under an exception, or remove it"
            yield Diagnostic(
                cause.where,
                "K309",
                f"no exception has the cause '{cause.name}'",
                hint,
                warning=True,
            )


def _unrepaired_causes(model: FaultModel) -> Iterator[Diagnostic]:
    for cause in model.causes.values():
        if not cause.stops and not model.repairs_of(cause.name):
            noted = (
                ", if only one that notes it" if cause.adds or cause.denies or cause.loses else ""
            )
            hint = (
                f"give it a repair{noted}, or say `stops: true`: the cell then stops safely and "
                "asks"
            )
            yield Diagnostic(
                cause.where, "K903", f"nothing repairs '{cause.name}'", hint, warning=True
            )


def _idle_tests(model: FaultModel) -> Iterator[Diagnostic]:
    for test in model.tests.values():
        if not any(
            test in model.telling(exception.counts) for exception in model.exceptions.values()
        ):
            hint = "name the causes under which its outcome differs"
            message = f"'{test.name}' tells no causes of any exception apart"
            yield Diagnostic(test.where, "K904", message, hint, warning=True)


def _inseparable_causes(model: FaultModel) -> Iterator[Diagnostic]:
    """Warnings about classes of causes that no test separates and no single repair serves."""
    for exception in model.exceptions.values():
        for group in model.alike(exception.name):
            if not any(all(r.cures.get(cause) for cause in group) for r in model.repairs.values()):
                message = (
                    f"no test tells {' and '.join(group)} apart, and no repair serves them all"
                )
                hint = "add a test that rules one of them out, or a repair for both"
                yield Diagnostic(exception.where, "K902", message, hint, warning=True)


def _too_many(model: FaultModel) -> Iterator[Diagnostic]:
    for exception in model.exceptions.values():
        yield from too_many_causes(exception)


def too_many_causes(exception: Interruption) -> Iterator[Diagnostic]:
    """An error if an exception has more causes than the selection of tests takes."""
    if len(exception.counts) > MAX_EXCEPTION_CAUSES:
        message = f"more than {MAX_EXCEPTION_CAUSES} causes of one exception"
        yield Diagnostic(
            exception.where, "K905", message, "split the exception by reply or operator"
        )
