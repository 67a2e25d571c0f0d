"""The state that is expected after some steps, and its correction by observations."""

from collections.abc import Collection, Iterable, Iterator, Sequence

from cellwright.engine.pipelines.revision.course import Course
from cellwright.engine.pipelines.simulation import Dynamics
from cellwright.engine.stages.macros.lifted.execution import changes_of
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.validation.changes import State, StepChange
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.model.domain import Domain, Kind
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.numbers import is_count
from cellwright.kb.terms import Atom, Function, ordered

SHOWN = 8  # names in a hint


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
    """The state where some atoms hold and others do not, with everything that follows by deductive operators.

    Raises `InvalidInput` for atoms that are not of this problem and for those that contradict each other.
    """
    return corrected(Dynamics(course.problem), here.state, holds, gone)


def corrected(
    dynamics: Dynamics, state: State, holds: Sequence[Atom], gone: Sequence[Atom]
) -> tuple[Atom, ...]:
    """`observed` for a state of a problem."""
    semantics = dynamics.semantics
    wrong = [
        *(found for atom in holds for found in _mistyped(atom, semantics, "--holds")),
        *(found for atom in gone for found in _mistyped(atom, semantics, "--gone")),
    ]
    if wrong:
        raise InvalidInput(wrong)
    _require_agreement(semantics.deduce(holds, (), frozenset()), holds, gone)
    return ordered(dynamics.asserted(state, holds, gone))


def following(
    before: Iterable[Atom], now: Iterable[Atom], said: Collection[Atom]
) -> tuple[tuple[Atom, bool], ...]:
    """The facts that nobody named and that changed nevertheless: those that hold now (True) and those that no longer do."""
    old, new, named = set(before), set(now), set(said)
    holds, gone = ordered(new - old - named), ordered(old - new - named)
    return (*((atom, True) for atom in holds), *((atom, False) for atom in gone))


def _mistyped(atom: Atom, semantics: Semantics, option: str) -> Iterator[Diagnostic]:
    """What is wrong with the arguments of an observed atom."""
    expected = semantics.problem.domain.predicates[atom.name].arguments
    for argument, type_ in zip(atom.arguments, expected, strict=True):
        if not semantics.statics.has_type(argument, type_):
            known = sorted(str(each.arguments[0]) for each in semantics.statics.named(type_))
            way = "one of" if len(known) <= SHOWN else "such as"
            hint = nearest(str(argument), known) or (f"{way} {', '.join(known[:SHOWN])}" if known else "")
            said = f"{argument} is no {type_}, but {atom.name} takes one here: {atom}"
            yield Diagnostic(Source(option), "K103", said, hint)


def _require_agreement(change: StepChange, holds: Sequence[Atom], gone: Sequence[Atom]) -> None:
    """Raises `InvalidInput` if observed facts exclude each other."""
    if change.contradiction is not None:
        said = f"{change.contradiction} is observed, but another observed fact denies it"
        raise _refused("--holds", "K301", said, f"these cannot hold together: {', '.join(map(str, holds))}")
    both = next((atom for atom in gone if atom in change.adds), None)
    if both is not None:
        said = f"{both} is said to be gone, but it follows from what is said to hold"
        raise _refused("--gone", "K301", said, "leave out one of the two")


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
        if not is_count(first) or not is_count(last or first):
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


def read_done(text: str, plan: Plan) -> list[StepId]:
    """The steps of a plan that are done, each with everything that must come before it. Raises `InvalidInput`."""
    done = read_steps(text, [step.id for step in plan.steps])
    before = plan.predecessors()
    for step in done:
        if missing := before[step] - set(done):
            needed = ", ".join(map(str, sorted(missing)))
            said = f"step {step} cannot be done before {'step' if len(missing) == 1 else 'steps'} {needed}"
            raise _refused("--done", "K411", said, "name every step that is done")
    return done


def _refused(option: str, code: str, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(option), code, message, hint)])
