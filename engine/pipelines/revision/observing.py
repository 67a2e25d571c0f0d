"""The state that is expected after some steps, and its correction by observations."""

from collections.abc import Iterable, Sequence

from engine.pipelines.revision.course import Course
from engine.stages.macros.lifted.execution import changes_of
from engine.stages.macros.lifted.situation import Situation
from engine.stages.validation.changes import Denial
from kb.asp import AspError, ground_term
from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from kb.model.domain import Domain, Kind
from kb.model.plan import StepId
from kb.terms import Atom, Function, ordered


def expected(course: Course, done: Iterable[StepId]) -> Situation:
    """The situation after the steps that are done, provided that each has had its effects."""
    names = set(done)
    facts = course.start.facts
    for change in changes_of(course.start, [step for step in course.plan.steps if step.id in names]):
        facts = change.applied(facts)
    return Situation(course.start.world, facts)


def observed(
    course: Course, here: Situation, holds: Sequence[Atom], gone: Sequence[Atom]
) -> tuple[Atom, ...]:
    """The state `here`, changed so that `holds` are true and `gone` are false, with what deductive operators conclude."""
    denials = tuple(Denial(atom, (), (), deduced=False) for atom in gone)
    state = here.state
    change = course.gate.semantics(course.problem).deduce(holds, denials, state)
    return ordered((state - change.ends) | change.adds)


def read_facts(text: str, domain: Domain, option: str) -> list[Atom]:
    """The ground fluents in the text of an option, separated by commas. Raises `InvalidInput`."""
    if not text.strip():
        return []
    try:
        found = ground_term(f"facts({text})")
    except AspError as error:
        raise _refused(
            option, "K107", f"'{text}' is not a list of facts: {error}", "write at(arm, table), free(arm)"
        ) from None
    assert isinstance(found, Function)
    return [_fluent(each, domain, option) for each in found.arguments]


def _fluent(found: object, domain: Domain, option: str) -> Atom:
    fluents = {name: p for name, p in domain.predicates.items() if p.kind is Kind.FLUENT}
    if not isinstance(found, Function) or found.name not in fluents:
        name = found.name if isinstance(found, Function) else str(found)
        raise _refused(option, "K101", f"unknown fluent '{name}'", nearest(name, list(fluents)))
    wanted = len(fluents[found.name].arguments)
    if len(found.arguments) != wanted:
        message = f"'{found.name}' takes {wanted} arguments, not {len(found.arguments)}"
        raise _refused(option, "K102", message, "")
    return found


def read_steps(text: str, known: Iterable[StepId]) -> list[StepId]:
    """The step numbers in a text such as `1..4, 7`. Raises `InvalidInput`."""
    steps = set(known)
    found: list[StepId] = []
    for part in filter(None, (each.strip() for each in text.split(","))):
        first, _, last = part.partition("..")
        if not first.isdecimal() or not (last or first).isdecimal():
            raise _refused(
                "--done", "K107", f"'{part}' is not a step number", "write numbers and ranges: 1..4, 7"
            )
        numbers = range(int(first), int(last or first) + 1)
        if not numbers:
            raise _refused("--done", "K113", f"'{part}' ends before it begins", f"write {last}..{first}")
        missing = next((number for number in numbers if number not in steps), None)
        if missing is not None:
            said = f"the last step is {max(steps, default=0)}"
            raise _refused("--done", "K410", f"the plan has no step {missing}", said)
        found += map(StepId, numbers)
    return found


def _refused(option: str, code: str, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(option), code, message, hint)])
