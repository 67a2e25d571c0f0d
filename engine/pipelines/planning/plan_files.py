"""Reads plans from files and has the independent checker look at them; plans nothing."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from cellwright.engine.model.time_limits import (
    Overstay,
    Unmet,
    measured_steps,
    missed_windows,
    turned_pairs,
    windows_of,
)
from cellwright.engine.model.window_breaches import WindowBreach
from cellwright.engine.pipelines.planning.target_files import generated_if_bare
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.plan_claims import claimed_starts, last_end
from cellwright.kb import loader
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import is_there
from cellwright.kb.model.plan_model import Claims, Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import find_target
from cellwright.kb.terms import Number, Term


def check_plan(
    problem: Problem, plan: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """Everything that the independent checker has against a plan and against what is claimed of it;
    empty if it is valid.

    Raises `InvalidInput`.
    """
    return validate_plan(problem, plan, name, claims)


def plan_end(plan: Plan, claims: Claims | None = None) -> int:
    """When the last step ends; each starts when it is said to, else as soon as it can."""
    return last_end(plan, claimed_starts(plan, claims or Claims()))


def unmet_times(problem: Problem, plan: Plan, claims: Claims | None = None) -> Unmet:
    """What static facts ask of the times of measurements and stays, and a plan does not keep."""
    words, declared = problem.domain.conventions, problem.domain.predicates
    starts = claimed_starts(plan, claims or Claims())
    broken = _breaches_in(problem, plan, starts) if problem.all_windows else ()
    if not declared.keys() & {words.window, words.before, words.longest_stay}:
        return Unmet(breaches=broken)
    facts = evaluate_statics(problem)
    windows = windows_of(facts.atoms(words.window, 3))
    pairs = [(str(first), str(second)) for first, second in facts.atoms(words.before, 2)]
    longest = {
        place: most.value
        for place, most in facts.atoms(words.longest_stay, 2)
        if isinstance(most, Number)
    }
    stays = _overstays_in(problem, plan, starts, longest) if longest else ()
    if not windows and not pairs:
        return Unmet(overstays=stays, breaches=broken)
    visits = measured_steps(problem, plan)
    return Unmet(
        missed_windows(windows, visits, starts),
        turned_pairs(pairs, visits, starts),
        stays,
        broken,
    )


def _overstays_in(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int], longest: Mapping[Term, int]
) -> tuple[Overstay, ...]:
    # loads what schedules
    from cellwright.engine.pipelines.planning.dwell_limits import find_overstays

    return find_overstays(problem, plan, starts, longest, Semantics(problem))


def _breaches_in(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int]
) -> tuple[WindowBreach, ...]:
    # loads what schedules
    from cellwright.engine.pipelines.planning.window_keeping import find_breaches

    return find_breaches(problem, plan, starts, Semantics(problem))


def plan_in(file: Path) -> tuple[Problem, Plan]:
    """The problem and the plan in a plan file; its domain may be one that is generated.

    Raises `InvalidInput`.
    """
    return claimed_in(file)[:2]


def claimed_in(file: Path) -> tuple[Problem, Plan, Claims]:
    """`plan_in`, and what else the file claims."""
    if not is_there(file) and _is_bundled(str(file)):
        hint = f"make a plan first: cellwright plan {file} -o plan.json"
        raise InvalidInput([Diagnostic(Source(str(file)), "K404", "this is no plan", hint)])
    return loader.load_claimed(file, generated_if_bare)


def _is_bundled(target: str) -> bool:
    with suppress(InvalidInput):
        return bool(find_target(target))
    return False
