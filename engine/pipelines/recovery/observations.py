"""Observed facts: the state expected after some steps, corrected, and the plan revised for it."""

from collections.abc import Collection, Iterable, Iterator, Sequence

from cellwright.engine.model.troubleshooting import Revision as Believed
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery import Dynamics
from cellwright.engine.pipelines.recovery.plan_revision import (
    PlanRevision,
    PlanUnderWay,
    Sequencer,
    no_sequence,
    revise_plan,
)
from cellwright.engine.pipelines.recovery.remaining_problem import KnownChanges, rest_after_steps
from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import CheckedChange, State
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint, unknown_name
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.numbers import is_count
from cellwright.kb.terms import Atom, Function, Number, Term, is_ground, sort_naturally

MAX_HINT_NAMES = 8  # names in a hint


def expected_situation(course: PlanUnderWay, done: Iterable[StepId]) -> Situation:
    """The situation after the steps that are done, provided that each has had its effects."""
    names = set(done)
    facts = course.start.facts
    for change in changes_of(
        course.start, [step for step in course.plan.steps if step.id in names]
    ):
        facts = change.applied(facts)
    return Situation(course.start.world, facts)


def observed_state(
    course: PlanUnderWay, here: Situation, holds: Sequence[Atom], gone: Sequence[Atom]
) -> tuple[Atom, ...]:
    """The state where some atoms hold and others do not, with everything that follows by deductive
    operators.

    Raises `InvalidInput` for atoms that are not of this problem and for those that contradict each
    other.
    """
    return correct_state(Dynamics(course.problem), here.state, holds, gone)


def correct_state(
    dynamics: Dynamics, state: State, holds: Sequence[Atom], gone: Sequence[Atom]
) -> tuple[Atom, ...]:
    """`observed` for a state of a problem."""
    semantics = dynamics.semantics
    wrong = [
        *(error for atom in holds for error in _type_errors(atom, semantics, "--holds")),
        *(error for atom in gone for error in _type_errors(atom, semantics, "--gone")),
    ]
    if wrong:
        raise InvalidInput(wrong)
    _require_agreement(semantics.deduce(holds, (), frozenset()), holds, gone)
    return sort_naturally(dynamics.asserted(state, holds, gone))


def following_facts(
    before: Iterable[Atom], now: Iterable[Atom], said: Collection[Atom]
) -> tuple[tuple[Atom, bool], ...]:
    """The facts that nobody named and that changed nevertheless: those that hold now (True) and
    those that no longer do.
    """
    old, new, named = set(before), set(now), set(said)
    holds, gone = sort_naturally(new - old - named), sort_naturally(old - new - named)
    return (*((atom, True) for atom in holds), *((atom, False) for atom in gone))


def _type_errors(atom: Atom, semantics: Semantics, option: str) -> Iterator[Diagnostic]:
    """What is wrong with the arguments of an observed atom."""
    expected = semantics.problem.domain.predicates[atom.name].arguments
    for argument, type_ in zip(atom.arguments, expected, strict=True):
        if not semantics.statics.has_type(argument, type_):
            known_objects = sorted(
                str(atom_of_type.arguments[0]) for atom_of_type in semantics.statics.named(type_)
            )
            lead = "one of" if len(known_objects) <= MAX_HINT_NAMES else "such as"
            hint = nearest_hint(str(argument), known_objects) or (
                f"{lead} {', '.join(known_objects[:MAX_HINT_NAMES])}" if known_objects else ""
            )
            reason = f"{argument} is no {type_}, but {atom.name} takes one here: {atom}"
            yield Diagnostic(Source(option), "K103", reason, hint)


def _require_agreement(change: CheckedChange, holds: Sequence[Atom], gone: Sequence[Atom]) -> None:
    """Raises `InvalidInput` if observed facts exclude each other."""
    if change.contradiction is not None:
        reason = f"{change.contradiction} is observed, but another observed fact denies it"
        raise _observation_error(
            "--holds", "K301", reason, f"these cannot hold together: {', '.join(map(str, holds))}"
        )
    both = next((atom for atom in gone if atom in change.adds), None)
    if both is not None:
        reason = f"{both} is said to be gone, but it follows from what is said to hold"
        raise _observation_error("--gone", "K301", reason, "leave out one of the two")


def read_facts(text: str, domain: Domain, option: str) -> list[Atom]:
    """The ground fluents in the text of an option, separated by commas. Raises `InvalidInput`."""
    if not text.strip():
        return []
    try:
        facts = ground_term(f"facts({text})")
    except AspError as error:
        raise _observation_error(
            option,
            "K107",
            f"'{text}' is not a list of facts: {error}",
            "write at(arm, table), free(arm)",
        ) from None
    assert isinstance(facts, Function)
    return [_fluent_of(argument, domain, option) for argument in facts.arguments]


def _fluent_of(term: object, domain: Domain, option: str) -> Atom:
    fluents = {name: p for name, p in domain.predicates.items() if p.kind is Kind.FLUENT}
    if not isinstance(term, Function) or term.name not in fluents:
        name = term.name if isinstance(term, Function) else str(term)
        raise _observation_error(
            option, "K101", f"unknown fluent '{name}'", nearest_hint(name, list(fluents))
        )
    arity = len(fluents[term.name].arguments)
    if len(term.arguments) != arity:
        message = f"'{term.name}' takes {arity} arguments, not {len(term.arguments)}"
        raise _observation_error(option, "K102", message, "")
    return term


def read_steps(text: str, known: Iterable[StepId]) -> list[StepId]:
    """The step numbers in a text such as `1..4, 7`. Raises `InvalidInput`."""
    steps = set(known)
    steps_read: list[StepId] = []
    for part in filter(None, (part_text.strip() for part_text in text.split(","))):
        first, _, last = part.partition("..")
        if not is_count(first) or not is_count(last or first):
            raise _observation_error(
                "--done",
                "K107",
                f"'{part}' is not a step number",
                "write numbers and ranges: 1..4, 7",
            )
        numbers = range(int(first), int(last or first) + 1)
        if not numbers:
            raise _observation_error(
                "--done", "K113", f"'{part}' ends before it begins", f"write {last}..{first}"
            )
        missing = next((number for number in numbers if number not in steps), None)
        if missing is not None:
            hint_text = f"the last step is {max(steps, default=0)}"
            raise _observation_error("--done", "K410", f"the plan has no step {missing}", hint_text)
        steps_read += map(StepId, numbers)
    return steps_read


def read_done(text: str, plan: Plan) -> list[StepId]:
    """The steps of a plan that are done, each with everything that must come before it.

    Raises `InvalidInput`.
    """
    done = read_steps(text, [step.id for step in plan.steps])
    before = plan.predecessors()
    for step in done:
        if missing := before[step] - set(done):
            needed = ", ".join(map(str, sorted(missing)))
            reason = (
                f"step {step} cannot be done before {'step' if len(missing) == 1 else 'steps'} "
                f"{needed}"
            )
            raise _observation_error("--done", "K411", reason, "name every step that is done")
    return done


def _observation_error(option: str, code: str, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(option), code, message, hint)])


LOST_OPTION = Source("--lost")
Words = tuple[str, str, str, str]
"""The texts of --done, --holds, --gone and --lost."""


def revised_now(
    problem: Problem,
    plan: Plan,
    said: Words,
    limits: SearchLimits = SearchLimits(),
    both: bool = False,
    sequencer: Sequencer = no_sequence,
) -> tuple[PlanRevision, tuple[tuple[Atom, bool], ...]]:
    """The revised plan, and the facts that follow from what is said; see `revise`.

    Raises `InvalidInput`.
    """
    done, holds, gone, lost = said
    steps = read_done(done, plan)
    present, absent = (
        read_facts(holds, problem.domain, "--holds"),
        read_facts(gone, problem.domain, "--gone"),
    )
    losses = _lost_resources(lost, problem)
    rest, rest_plan = rest_after_steps(problem, plan, steps)
    under_way = PlanUnderWay.of(forbid_steps(rest, losses), rest_plan)
    state = observed_state(under_way, expected_situation(under_way, ()), present, absent)
    withdrawn = tuple(
        (atom, "it is observed to be gone") for atom in absent if atom in rest.initial
    )
    follows = following_facts(rest.initial, state, (*present, *absent))
    changes = KnownChanges(
        Dynamics(rest), Believed(withdrawn=withdrawn, lost=losses, follows=follows)
    )
    revised = revise_plan(under_way, (), state, limits, both, changes.obstacles(state), sequencer)
    return revised, follows


def _lost_resources(text: str, problem: Problem) -> tuple[str, ...]:
    """Names of objects or of resources, or terms such as `slot(freezer, 1)`.

    Raises `InvalidInput`.
    """
    resources = {
        str(resource)
        for o in problem.domain.operators
        for resource in o.resources
        if is_ground(resource)
    }
    known_names = {*problem.domain.objects, *problem.objects, *resources}
    try:
        listed = ground_term(f"lost({text})") if text.strip() else Function("lost")
    except AspError as error:
        hint = "write names and terms, separated by commas: mars_gripper, slot(freezer, 1)"
        raise InvalidInput(
            [Diagnostic(LOST_OPTION, "K107", f"'{text}' is not a list: {error}", hint)]
        ) from None
    terms = listed.arguments if isinstance(listed, Function) else ()
    names = [
        *_unknown_names(terms, problem, known_names),
        *(str(term) for term in terms if isinstance(term, Number)),
    ]
    wrong = [unknown_name("resource", name, sorted(known_names), LOST_OPTION) for name in names]
    if wrong:
        raise InvalidInput(wrong)
    return tuple(map(str, terms))


def _unknown_names(
    terms: Iterable[Term], problem: Problem, known: Collection[str]
) -> Iterator[str]:
    """The names in some terms that nothing of the problem has."""
    for term in terms:
        if isinstance(term, Function) and term.arguments and term.name in problem.domain.functions:
            yield from _unknown_names(term.arguments, problem, known)
        elif not isinstance(term, Number) and str(term) not in known:
            yield str(term)
