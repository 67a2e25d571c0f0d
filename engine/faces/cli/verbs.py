"""The verbs of the command line. Each is imported only when it is called, so that no verb waits for the modules of another."""

from importlib import import_module
from typing import Any

VERBS = {
    "abort": "orders:abort",
    "add": "orders:add",
    "answer": "orders:answer",
    "approve": "orders:approve",
    "back": "orders:back",
    "cell": "cell:app",
    "check": "check:check",
    "continue": "orders:go_on",
    "correct": "orders:correct",
    "devices": "devices:app",
    "diagnose": "diagnose:diagnose",
    "driver": "driver:app",
    "explain": "explain:explain",
    "export": "export:export",
    "format": "format_:format_files",
    "handey": "handey:app",
    "import": "import_:app",
    "init": "init:init",
    "interrupt": "orders:interrupt",
    "lsp": "lsp:lsp",
    "macros": "macros:app",
    "measurement": "measurement:app",
    "monitor": "monitor:monitor",
    "motion": "motion:app",
    "place": "place:place",
    "plan": "plan:plan",
    "prepare": "prepare:prepare",
    "resume": "resume:resume",
    "retry": "orders:retry",
    "results": "results:results",
    "revise": "revise:revise",
    "run": "run:run",
    "schedule": "schedule:schedule",
    "schema": "check:schema",
    "sequence": "sequence:sequence",
    "skip": "orders:skip",
    "states": "states:states",
    "stop": "orders:stop",
    "store": "store:app",
    "test": "golden:golden_plans",
    "validate": "validate:validate",
}
"""For each verb, its module and its function (or its group of verbs)."""


def is_group(name: str) -> bool:
    """Whether a verb is a group of verbs."""
    return VERBS[name].endswith(":app")


def verb(name: str) -> Any:
    """The function of a verb, or the application of its group."""
    module, _, attribute = VERBS[name].partition(":")
    return getattr(import_module(f"cellwright.engine.faces.cli.{module}"), attribute)
