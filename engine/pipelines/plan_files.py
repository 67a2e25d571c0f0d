"""Plans in files, and what the checker has against them. Nothing is planned here, so a check starts without any planner."""

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from cellwright.engine.model.stays import Overstay
from cellwright.engine.model.windows import Unmet, missed, turned, visits_of, windows_of
from cellwright.engine.stages.validation import validate
from cellwright.engine.stages.validation.claims import makespan, times
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import File, is_there, read_file
from cellwright.kb.model.plan import Claims, Plan, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.targets import CONTACTS_FILE, find
from cellwright.kb.terms import Number, Term

OPERATORS = re.compile(r"^['\"]?(operators|use)['\"]?\s*:", re.MULTILINE)  # its own, or those of devices


def check_plan(
    problem: Problem, made: Plan, name: str = "plan", claims: Claims | None = None
) -> list[Diagnostic]:
    """Everything that the independent checker has against a plan and against what is claimed of it; empty if it is valid.

    Raises `InvalidInput`.
    """
    return validate(problem, made, name, claims)


def ending(made: Plan, claims: Claims | None = None) -> int:
    """When the last step ends; each starts when it is said to, else as soon as it can."""
    return makespan(made, times(made, claims or Claims()))


def unmet(problem: Problem, made: Plan, claims: Claims | None = None) -> Unmet:
    """What static facts ask of the times of measurements and stays, and a plan does not keep."""
    words, declared = problem.domain.conventions, problem.domain.predicates
    if not declared.keys() & {words.window, words.before, words.longest_stay}:
        return Unmet()
    facts, starts = evaluated(problem), times(made, claims or Claims())
    windows = windows_of(facts.atoms(words.window, 3))
    pairs = [(str(first), str(second)) for first, second in facts.atoms(words.before, 2)]
    longest = {
        place: most.value for place, most in facts.atoms(words.longest_stay, 2) if isinstance(most, Number)
    }
    stays = _overstays(problem, made, starts, longest) if longest else ()
    if not windows and not pairs:
        return Unmet(overstays=stays)
    visits = visits_of(problem, made)
    return Unmet(missed(windows, visits, starts), turned(pairs, visits, starts), stays)


def _overstays(
    problem: Problem, made: Plan, starts: Mapping[StepId, int], longest: Mapping[Term, int]
) -> tuple[Overstay, ...]:
    from cellwright.engine.pipelines.stays import overstays  # loads what schedules

    return overstays(problem, made, starts, longest, Semantics(problem))


def plan_in(file: Path) -> tuple[Problem, Plan]:
    """The problem and the plan in a plan file; its domain may be one that is generated. Raises `InvalidInput`."""
    return claimed_in(file)[:2]


def claimed_in(file: Path) -> tuple[Problem, Plan, Claims]:
    """`plan_in`, and what else the file claims."""
    from cellwright.kb.loader.plan import load_claimed

    if not is_there(file) and _is_bundled(str(file)):
        hint = f"make a plan first: cellwright plan {file} -o plan.json"
        raise InvalidInput([Diagnostic(Source(str(file)), "K404", "this is no plan", hint)])
    return load_claimed(file, generated_if_bare)


def _is_bundled(target: str) -> bool:
    with suppress(InvalidInput):
        return bool(find(target))
    return False


def generated_if_bare(domain: Path) -> File | None:
    """The generated domain for a domain file without operators that has a contact model beside it, else None."""
    if not domain.with_name(CONTACTS_FILE).is_file() or OPERATORS.search(read_file(domain).text):
        return None
    from cellwright.engine.pipelines.task_space import generated  # slow to import

    return generated(domain)
