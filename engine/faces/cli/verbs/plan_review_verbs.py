"""The verbs `explain`, `validate` and `revise`: questions about a plan that is there or not."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import (
    Command,
    Expansions,
    Format,
    Goals,
    Pddl,
    Seed,
    TimeLimit,
)
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS, GAVE_UP, INTERRUPTED, exit_code
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.pipelines import planning

if TYPE_CHECKING:
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.plan_model import Claims, Plan
    from cellwright.kb.model.planning_problem import Problem


def explain_target(
    target: Annotated[str, Argument(help="a problem; or, with STEP, a plan in JSON")],
    step: Annotated[int | None, Argument(help="the number of a step of the plan")] = None,
    goals: Goals = "",
    command: Command = "",
    format: Format = AnswerForm.TEXT,
    time_limit: TimeLimit = None,
    expansions: Expansions = None,
) -> None:
    """Explain why TARGET has no plan and which changes would allow one; or why STEP is in the
    plan TARGET.
    """
    if step is None:
        give_answer(
            lambda: _explain_problem(target, goals, command, time_limit, expansions), format
        )
    refuse_idle({"--goals": goals, "--command": command}, "on a step: the plan contains its goals")
    give_answer(lambda: _explain_step(Path(target), step), format)


def _explain_problem(
    target: str, goals: str, command: str, time_limit: float | None, expansions: int | None
) -> VerbAnswer:
    from cellwright.engine.pipelines import explanation
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    with SearchInterruption(time_limit) as interrupted:
        problem = planning.problem_of(target, goals, command)
        limits = SearchLimits(expansions_within(expansions, time_limit), interrupted=interrupted)
        plan_explanation = explanation.explain_infeasibility(problem, limits)
    code = (
        INTERRUPTED if interrupted.heard else GAVE_UP if plan_explanation.status == "unknown" else 0
    )
    return VerbAnswer(
        plan_explanation.status,
        report.explanation_entry(plan_explanation),
        lambda: report.explanation_text(plan_explanation),
        code,
    )


def _explain_step(file: Path, number: int) -> VerbAnswer:
    from cellwright.engine.pipelines.explanation.step_purposes import explain_step
    from cellwright.engine.pipelines.planning.plan_files import plan_in
    from cellwright.engine.stages.grounding import ground

    problem, plan = plan_in(file)
    reason_of_step = explain_step(ground(problem), plan, number, str(file))
    return VerbAnswer(
        "ok", report.step_entry(reason_of_step), lambda: report.step_reason(reason_of_step)
    )


def validate_plan_file(
    file: Annotated[Path, Argument(help="a plan in JSON; with --pddl the PDDL domain")],
    task: Annotated[Path | None, Argument(help="with --pddl: the PDDL problem")] = None,
    made: Annotated[
        Path | None, Argument(help="with --pddl: the plan, one action per line")
    ] = None,
    pddl: Pddl = False,
    problem: Annotated[
        str, Option(help="check it against this problem instead of the one it carries")
    ] = "",
    export: Annotated[
        str, Option(help="FILE is a plan that a PDDL planner found for the export of this target")
    ] = "",
    goals: Goals = "",
    command: Command = "",
    ground: Annotated[
        bool, Option("--ground", help="with --export: the target was exported with --ground")
    ] = False,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Check the plan in FILE, or, with --pddl, the plan MADE for a PDDL task, with the
    independent checker.
    """
    if (pddl, pddl) != (task is not None, made is not None):
        alone = "give the plan's file alone, which carries its problem (--problem names another); "
        raise make_misfit(f"{'' if pddl else alone}--pddl takes a domain, a problem and a plan")
    if not export:
        own = {"--goals": goals, "--command": command, "--ground": ground}
        refuse_idle(own, "without --export: a plan contains its problem")
    refuse_idle(
        {"--problem": problem and (pddl or export)},
        "with --pddl or --export, which name the problem",
    )
    refuse_idle({"--pddl": pddl and export}, "with --export, which takes one file")
    if export:
        give_answer(lambda: _validate_export(file, (export, goals, command), ground), format)
    give_answer(
        lambda: (
            _validate_plan(file, problem)
            if not (pddl and task and made)
            else _validate_pddl(file, task, made)
        ),
        format,
    )


def _validate_export(file: Path, wanted: tuple[str, str, str], ground: bool) -> VerbAnswer:
    problem = planning.problem_of(*wanted)
    return _plan_verdict(
        problem, interop.read_exported_plan(problem, file, lifted=not ground), str(file)
    )


def _validate_pddl(domain: Path, task: Path, made: Path) -> VerbAnswer:
    from cellwright.engine.formats.interop.pddl import durative

    if durative.has_times(domain, task):
        return _validate_timed(domain, task, made)
    read = interop.read_pddl_task(domain, task)
    return _plan_verdict(
        read.problem, interop.read_plan(read, made), str(made), warnings=read.warnings
    )


def _validate_timed(domain: Path, task: Path, made: Path) -> VerbAnswer:
    """The verdict of the checker of time."""
    from cellwright.engine.formats.interop.pddl import durative
    from cellwright.engine.formats.interop.pddl.durative import plans
    from cellwright.engine.formats.report.plans import timed_plan_report
    from cellwright.engine.pipelines.planning import temporal_plans

    read = durative.read_temporal(domain, task)
    plan = plans.read_timed_plan(read, made)
    wrong = temporal_plans.check_timed_plan(read.problem, plan, str(made))
    if wrong:
        content = {"steps": len(plan.steps), "breaches": len(wrong)}
        return VerbAnswer("invalid", content, code=FINDINGS, diagnostics=tuple(wrong))
    said, content = timed_plan_report.verdict(plan)
    return VerbAnswer("valid", content, text=lambda: rich_parts.Text(said))


def _validate_plan(file: Path, target: str) -> VerbAnswer:
    own, plan, claims = planning.claimed_in(file)
    if target:
        own = planning.problem_of(target)
    return _plan_verdict(own, plan, str(file), claims)


def _plan_verdict(
    problem: "Problem",
    plan: "Plan",
    name: str,
    claims: "Claims | None" = None,
    warnings: "tuple[Diagnostic, ...]" = (),
) -> VerbAnswer:
    """The verdict of the checker.

    What it prints of the plan is computed from the steps, which are as the domain says.
    """
    from cellwright.engine.model.task_costs import cost_number, cost_text
    from cellwright.engine.pipelines.planning import plan_files

    plan_diagnostics = plan_files.check_plan(problem, plan, name, claims)
    if plan_diagnostics:
        counts = {"steps": len(plan.steps), "links": len(plan.links)}
        return VerbAnswer(
            "invalid", counts, code=FINDINGS, diagnostics=(*plan_diagnostics, *warnings)
        )
    last = plan_files.plan_end(plan, claims)
    content: dict[str, object] = {
        "steps": len(plan.steps),
        "cost": cost_number(plan.cost, problem.domain),
        "links": len(plan.links),
    }
    lasts = f", makespan {last} {problem.domain.time_unit}" if last else ""
    steps, links = count_noun(len(plan.steps), "step"), count_noun(len(plan.links), "causal link")
    verdict_text = f"valid: {steps}, cost {cost_text(plan.cost, problem.domain)}{lasts}, {links}"
    unmet = plan_files.unmet_times(problem, plan, claims)
    content |= unmet.entry()
    verdict_text = "\n".join((verdict_text, *unmet.lines(problem.domain.time_unit)))
    return VerbAnswer(
        "valid", content, text=lambda: rich_parts.Text(verdict_text), diagnostics=warnings
    )


def revise_plan_file(
    file: Annotated[Path, Argument(help="a plan in JSON")],
    done: Annotated[str, Option(help="the steps that are done, such as 1..4, 7")] = "",
    holds: Annotated[str, Option(help="facts that hold unexpectedly")] = "",
    gone: Annotated[str, Option(help="facts that unexpectedly do not hold")] = "",
    lost: Annotated[
        str, Option(help="tools and resources that can no longer be used, such as us_probe")
    ] = "",
    both: Annotated[
        bool, Option("--both", help="always replan too, and take the cheaper plan")
    ] = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Repair the plan in FILE for the observed state, or replan, whichever is cheaper."""
    observed = Observations(done, holds, gone, lost)
    give_answer(lambda: _revise_plan(file, observed, both, (time_limit, expansions, seed)), format)


@dataclass(frozen=True, slots=True)
class Observations:
    """What is known of the world, as it is given: steps done, facts that hold or do not hold,
    and what is lost.
    """

    done: str
    holds: str
    gone: str
    lost: str


def _revise_plan(
    file: Path, given: Observations, both: bool, work: tuple[float | None, int | None, int]
) -> VerbAnswer:
    from cellwright.engine.pipelines.planning.plan_files import plan_in
    from cellwright.engine.pipelines.recovery.observations import revised_now
    from cellwright.engine.pipelines.recovery.replanning import plan_in_sequence
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    seconds, expansions, seed = work
    with SearchInterruption(seconds) as interrupted:
        problem, plan = plan_in(file)
        limits = SearchLimits(
            expansions_within(expansions, seconds), interrupted=interrupted, seed=seed
        )
        revision, follows = revised_now(
            problem,
            plan,
            (given.done, given.holds, given.gone, given.lost),
            limits,
            both,
            plan_in_sequence,
        )
    content = {
        **report.outcome_entry(revision.outcome, revision.problem),
        "revision": report.revision_entry(revision, follows),
    }
    code = INTERRUPTED if interrupted.heard else exit_code(revision.outcome)
    return VerbAnswer(
        report.outcome_status(revision.outcome),
        content,
        lambda: report.revision_text(revision, follows),
        code,
    )
