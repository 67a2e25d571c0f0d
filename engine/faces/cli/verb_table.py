"""Table of verbs: where each is and what it does, and the limits that every verb takes."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from typing import Any, NamedTuple

from cellwright.engine.faces.cli.options.shared_options import MemoryLimit, TimeLimit
from cellwright.engine.faces.cli.process.process_limits import watching_command
from cellwright.engine.faces.cli.process.progress_line import showing_progress


class Verb(NamedTuple):
    """Where a verb is, as MODULE:FUNCTION (or MODULE:app, a group of verbs), and what it does."""

    place: str
    summary: str


VERBS_FOR: dict[str, dict[str, Verb]] = {
    "Describe a cell": {
        "init": Verb(
            "domain_verbs:init_domain",
            "Write a small commented domain into FOLDER, with problems, a fault base and a golden "
            "plan",
        ),
        "devices": Verb("device_verbs:app", "Look at the devices that a domain can use"),
        "check": Verb("domain_verbs:check_target", "Report all errors in TARGET"),
        "format": Verb(
            "domain_verbs:format_domain_files", "Give FILEs their usual indentation and spaces"
        ),
        "test": Verb(
            "domain_verbs:golden_plans",
            "Plan every problem of TARGET again and compare the answer with its golden file",
        ),
        "schema": Verb(
            "domain_verbs:print_schema", "Print the JSON Schema of a kind of file, for editors"
        ),
        "lsp": Verb("lsp_verb:serve_lsp", "Serve an editor that writes domains"),
    },
    "Plan": {
        "plan": Verb(
            "plan_verb:plan_target",
            "Print a plan for TARGET, or, with --pddl, for the PDDL domain TARGET and the PDDL "
            "problem TASK",
        ),
        "schedule": Verb(
            "schedule_verb:schedule_target",
            "Print a short schedule for the steps of a plan for TARGET, or for the stages of a "
            "shop",
        ),
        "sequence": Verb(
            "sequence_verb:sequence_visits",
            "Print the best order found for the visits of TARGET, with a lower bound on the cost "
            "of any order",
        ),
        "explain": Verb(
            "plan_review_verbs:explain_target",
            "Explain why TARGET has no plan and which changes would allow one",
        ),
        "validate": Verb(
            "plan_review_verbs:validate_plan_file",
            "Check the plan in FILE, or, with --pddl, the plan MADE for a PDDL task, with the "
            "independent checker",
        ),
        "revise": Verb(
            "plan_review_verbs:revise_plan_file",
            "Repair the plan in FILE for the observed state, or replan, whichever is cheaper",
        ),
        "prepare": Verb(
            "prepare_verb:prepare_target",
            "Plan every problem of TARGET, sequence its measurements, and fill the store before "
            "plans are needed",
        ),
    },
    "Carry out": {
        "run": Verb(
            "run_verbs:run_target",
            "Plan TARGET, carry the plan out, handle what goes wrong, and go on until the goals "
            "are reached",
        ),
        "resume": Verb("run_verbs:resume_named_run", "Go on with RUN from its journal"),
        "monitor": Verb(
            "monitor_verb:serve_monitor",
            "Serve a page on which runs are watched, steered and replayed",
        ),
        "results": Verb(
            "results_verb:show_results",
            "Show what RUN has measured, and the history of each object",
        ),
        "driver": Verb(
            "driver_verbs:app", "Try out the controller of a cell, or serve a simulated one"
        ),
    },
    "Tell a run that goes on": {
        "stop": Verb("run_order_verbs:stop_run", "Stop RUN at once"),
        "interrupt": Verb(
            "run_order_verbs:interrupt_run",
            "Have RUN pause at the end of its current goal, with empty hands",
        ),
        "continue": Verb("run_order_verbs:go_on", "Have RUN go on after a pause"),
        "approve": Verb("run_order_verbs:approve_run_plan", "Approve the plan that RUN waits with"),
        "answer": Verb("run_order_verbs:answer_question", "Answer what RUN asks a person"),
        "add": Verb(
            "run_order_verbs:add_run_command",
            "Give RUN a further command, a due date or a priority",
        ),
        "skip": Verb("run_order_verbs:skip_step", "At a pause of RUN, take STEP for done"),
        "retry": Verb(
            "run_order_verbs:retry_rest",
            "At a pause of RUN, try what is left once more, from the world as it is",
        ),
        "back": Verb(
            "run_order_verbs:go_back_to_step",
            "At a pause of RUN, go back to STEP and do it, and what comes behind it, again",
        ),
        "correct": Verb(
            "run_order_verbs:correct_world",
            "At a pause of RUN, correct what it holds for true, and have it plan on from there",
        ),
        "abort": Verb("run_order_verbs:abort_run", "End RUN for good"),
    },
    "Find faults": {
        "diagnose": Verb(
            "diagnose_verb:diagnose_target", "Find the cause of an exception of TARGET"
        ),
    },
    "Geometry, parts and measurements": {
        "cell": Verb("cell_verbs:app", "Look at the geometry of a cell"),
        "motion": Verb("motion_verbs:app", "Plan motions of an arm"),
        "states": Verb(
            "states_verb:show_contact_states",
            "Generate the contact states of DOMAIN from its contact model, and the net of the "
            "steps between them",
        ),
        "place": Verb(
            "place_verb:place_part_on_base",
            "Place a part ON another one, as the relations of a scene say",
        ),
        "handey": Verb(
            "handey_verbs:app",
            "Assemble parts, plan portions of their motions, and follow an operator",
        ),
        "measurement": Verb(
            "measurement_verbs:app",
            "List and change the measurements of a problem, and see what was measured",
        ),
    },
    "Keep and exchange": {
        "store": Verb(
            "store_verbs:app",
            "Check, back up, restore and move a library, with the closed cases, sequences, poses "
            "and journals in it",
        ),
        "macros": Verb("macro_verbs:app", "Look at a library of learned MACROPs, and change it"),
        "import": Verb("import_verbs:app", "Make problems from files of other systems"),
        "export": Verb(
            "export_verb:export_target",
            "Write TARGET as domain.pddl and problem.pddl, so that any PDDL planner can solve it, "
            "PLAN as a behaviour tree, or points",
        ),
    },
}
"""The verbs under each heading, in the order of help."""

VERBS = {name: verb for verbs in VERBS_FOR.values() for name, verb in verbs.items()}


def load_verb(name: str) -> Any:
    """The function of a verb, or the application of its group."""
    module, _, attribute = VERBS[name].place.partition(":")
    return getattr(import_module(f"cellwright.engine.faces.cli.verbs.{module}"), attribute)


VERB_LIMITS = {"time_limit": TimeLimit, "memory_limit": MemoryLimit}


def run_limited(verb: Callable[..., None], name: str, options: Mapping[str, Any]) -> None:
    """Call a verb with the limits that are among its options.

    If it is slow, it tells what it does, by its `name`.
    """
    with (
        watching_command(options.get("time_limit"), options.get("memory_limit")),
        showing_progress(name),
    ):
        taken = verb.__annotations__
        verb(
            **{
                name: value
                for name, value in options.items()
                if name in taken or name not in VERB_LIMITS
            }
        )


def has_limits(verb: Callable[..., None]) -> bool:
    """Whether a verb came from `limit_verb`."""
    return getattr(verb, "has_limits", False)


def limit_verb(verb: Callable[..., None], name: str) -> Callable[..., None]:
    """The verb as typer takes it, with its own parameters and those limits that are not among
    them.
    """
    signature = inspect.signature(verb)
    limits = [
        inspect.Parameter(limit, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for limit, kind in VERB_LIMITS.items()
        if limit not in signature.parameters
    ]

    @wraps(verb)
    def run(**options: Any) -> None:
        run_limited(verb, name, options)

    run.has_limits = True  # type: ignore[attr-defined]
    taken = [*signature.parameters.values(), *limits]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in taken}
    run.__signature__ = signature.replace(parameters=taken)  # type: ignore[attr-defined]
    return run
