"""Table of verbs with the module and function of each, and the limits that every verb takes."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from typing import Any

from cellwright.engine.faces.cli.option_declarations import typer_annotation
from cellwright.engine.faces.cli.options.shared_options import MemoryLimit, TimeLimit
from cellwright.engine.faces.cli.process.process_limits import watching_command
from cellwright.engine.faces.cli.process.progress_line import showing_progress

VERBS = {
    "abort": "run_order_verbs:abort_run",
    "add": "run_order_verbs:add_run_command",
    "answer": "run_order_verbs:answer_question",
    "approve": "run_order_verbs:approve_run_plan",
    "back": "run_order_verbs:go_back_to_step",
    "cell": "cell_verbs:app",
    "check": "domain_verbs:check_target",
    "continue": "run_order_verbs:go_on",
    "correct": "run_order_verbs:correct_world",
    "devices": "device_verbs:app",
    "diagnose": "diagnose_verb:diagnose_target",
    "driver": "driver_verbs:app",
    "explain": "plan_review_verbs:explain_target",
    "export": "export_verb:export_target",
    "format": "domain_verbs:format_domain_files",
    "handey": "handey_verbs:app",
    "import": "import_verbs:app",
    "init": "domain_verbs:init_domain",
    "interrupt": "run_order_verbs:interrupt_run",
    "lsp": "lsp_verb:serve_lsp",
    "macros": "macro_verbs:app",
    "measurement": "measurement_verbs:app",
    "monitor": "monitor_verb:serve_monitor",
    "motion": "motion_verbs:app",
    "place": "place_verb:place_part_on_base",
    "plan": "plan_verb:plan_target",
    "prepare": "prepare_verb:prepare_target",
    "resume": "run_verbs:resume_named_run",
    "retry": "run_order_verbs:retry_rest",
    "results": "results_verb:show_results",
    "revise": "plan_review_verbs:revise_plan_file",
    "run": "run_verbs:run_target",
    "schedule": "schedule_verb:schedule_target",
    "schema": "domain_verbs:print_schema",
    "sequence": "sequence_verb:sequence_visits",
    "skip": "run_order_verbs:skip_step",
    "states": "states_verb:show_contact_states",
    "stop": "run_order_verbs:stop_run",
    "store": "store_verbs:app",
    "test": "domain_verbs:golden_plans",
    "validate": "plan_review_verbs:validate_plan_file",
}
"""For each verb, its module and its function (or its group of verbs)."""


def is_group(name: str) -> bool:
    """Whether a verb is a group of verbs."""
    return VERBS[name].endswith(":app")


def load_verb(name: str) -> Any:
    """The function of a verb, or the application of its group."""
    module, _, attribute = VERBS[name].partition(":")
    return getattr(import_module(f"cellwright.engine.faces.cli.verbs.{module}"), attribute)


VERB_LIMITS = {"time_limit": TimeLimit, "memory_limit": MemoryLimit}


def verb_parameters(verb: Callable[..., None]) -> Mapping[str, inspect.Parameter]:
    """What a verb takes by name: its own parameters, and those limits that are not among them."""
    own = inspect.signature(verb).parameters
    added = {
        name: inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in VERB_LIMITS.items()
        if name not in own
    }
    return {**own, **added}


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


def limit_verb(verb: Callable[..., None], name: str) -> Callable[..., None]:
    """The verb as typer takes it, with its limits."""
    taken = [
        parameter.replace(annotation=typer_annotation(parameter.annotation))
        for parameter in verb_parameters(verb).values()
    ]

    @wraps(verb)
    def run(**options: Any) -> None:
        run_limited(verb, name, options)

    run.__annotations__ = {parameter.name: parameter.annotation for parameter in taken}
    run.__signature__ = inspect.signature(verb).replace(parameters=taken)  # type: ignore[attr-defined]
    return run
