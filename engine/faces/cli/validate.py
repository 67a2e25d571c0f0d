"""`cellwright validate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Command, Format, Goals, Pddl
from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from cellwright.kb.model.plan import Claims, Plan
    from cellwright.kb.model.problem import Problem


def validate(
    file: Annotated[Path, Argument(help="a plan in JSON; with --pddl the PDDL domain")],
    task: Annotated[Path | None, Argument(help="with --pddl: the PDDL problem")] = None,
    made: Annotated[Path | None, Argument(help="with --pddl: the plan, one action per line")] = None,
    pddl: Pddl = False,
    problem: Annotated[str, Option(help="check it against this problem instead of the one it carries")] = "",
    export: Annotated[
        str, Option(help="FILE is a plan that a PDDL planner found for the export of this target")
    ] = "",
    goals: Goals = "",
    command: Command = "",
    ground: Annotated[
        bool, Option("--ground", help="with --export: the target was exported with --ground")
    ] = False,
    format: Format = Form.TEXT,
) -> None:
    """Check the plan in FILE, or, with --pddl, the plan MADE for a PDDL task, with the independent checker."""
    if (pddl, pddl) != (task is not None, made is not None):
        alone = "give the plan's file alone, which carries its problem (--problem names another); "
        raise misfit(f"{'' if pddl else alone}--pddl takes a domain, a problem and a plan")
    if not export:
        own = {"--goals": goals, "--command": command, "--ground": ground}
        refuse_idle(own, "without --export: a plan contains its problem")
    refuse_idle(
        {"--problem": problem and (pddl or export)}, "with --pddl or --export, which name the problem"
    )
    refuse_idle({"--pddl": pddl and export}, "with --export, which takes one file")
    if export:
        give(lambda: _validate_export(file, (export, goals, command), ground), format)
    give(
        lambda: (
            _validate(file, problem) if not (pddl and task and made) else _validate_pddl(file, task, made)
        ),
        format,
    )


def _validate_export(file: Path, wanted: tuple[str, str, str], ground: bool) -> Answer:
    from cellwright.engine.formats.interop.pddl.files import read_exported_plan
    from cellwright.engine.pipelines import planning

    problem = planning.problem_of(*wanted)
    return _judged(problem, read_exported_plan(problem, file, lifted=not ground), str(file))


def _validate_pddl(domain: Path, task: Path, made: Path) -> Answer:
    from cellwright.engine.formats.interop.pddl import read_pddl
    from cellwright.engine.formats.interop.pddl.plans import read_plan

    read = read_pddl(domain, task)
    return _judged(read.problem, read_plan(read, made), str(made))


def _validate(file: Path, target: str) -> Answer:
    from cellwright.engine.pipelines.plan_files import claimed_in

    own, plan, claims = claimed_in(file)
    if target:
        from cellwright.engine.pipelines.planning import problem_of  # slow to import

        own = problem_of(target)
    return _judged(own, plan, str(file), claims)


def _judged(problem: "Problem", plan: "Plan", name: str, claims: "Claims | None" = None) -> Answer:
    """The verdict of the checker. What it prints of the plan is computed from the steps, which are as the domain says."""
    from rich.text import Text

    from cellwright.engine.pipelines import plan_files

    found = plan_files.check_plan(problem, plan, name, claims)
    if found:
        counts = {"steps": len(plan.steps), "links": len(plan.links)}
        return Answer("invalid", counts, code=FINDINGS, diagnostics=tuple(found))
    last = plan_files.ending(plan, claims)
    content: dict[str, object] = {"steps": len(plan.steps), "cost": plan.cost, "links": len(plan.links)}
    lasts = f", makespan {last} {problem.domain.time_unit}" if last else ""
    steps, links = counted(len(plan.steps), "step"), counted(len(plan.links), "causal link")
    said = f"valid: {steps}, cost {plan.cost}{lasts}, {links}"
    unmet = plan_files.unmet(problem, plan, claims)
    content |= unmet.entry()
    said = "\n".join((said, *unmet.lines(problem.domain.time_unit)))
    return Answer("valid", content, text=lambda: Text(said))
