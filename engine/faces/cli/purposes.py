"""What verbs and options are for: the order and the headings under which help lists them."""

import re
from typing import Any

VERBS_FOR = {
    "Describe a cell": ("init", "devices", "check", "format", "test", "schema", "lsp"),
    "Plan": ("plan", "schedule", "sequence", "explain", "validate", "revise", "prepare"),
    "Carry out": ("run", "resume", "monitor", "results", "driver"),
    "Tell a run that goes on": (
        "stop", "interrupt", "continue", "approve", "answer", "add", "skip", "retry", "back", "correct", "abort",
    ),
    "Find faults": ("diagnose",),
    "Geometry, parts and measurements": ("cell", "motion", "states", "place", "handey", "measurement"),
    "Keep and exchange": ("store", "macros", "import", "export"),
}  # fmt: skip
"""The verbs under each heading, in the order of help."""

OPTIONS_FOR = {
    "What is wanted": (
        "--goals", "--command", "--objective", "--order", "--window", "--lasts", "--before", "--margin", "--upright",
    ),
    "The answer": (
        "--format", "--output", "--stats", "--folded", "--explain", "--tree", "--events", "--watch", "--azimuth", "--elevation",
    ),
    "Limits": (
        "--time-limit", "--memory-limit", "--expansions", "--work", "--budget", "--bridges", "--refine", "--seed", "--race",
        "--anytime", "--jobs", "--cluster",
    ),
}  # fmt: skip
"""The options under each heading, wherever a command has many; all others come first."""

MANY = 8  # options that need headings
_HEADING = {verb: heading for heading, verbs in VERBS_FOR.items() for verb in verbs}
_OPTION = {option: heading for heading, options in OPTIONS_FOR.items() for option in options}


def arranged(command: Any, verb: str = "") -> Any:
    """The same command (and those of a group) with headings, arguments in capitals and one sentence for lists of commands."""
    command.rich_help_panel = _HEADING.get(verb)
    command.short_help = first_sentence(command.help or "")
    headed = len(command.params) > MANY
    for each in command.params:
        if each.param_type_name == "argument":
            each.metavar = each.metavar or each.name.upper() + ("..." if each.nargs != 1 else "")
        elif headed:
            each.rich_help_panel = _OPTION.get(each.opts[0])
    for inner in getattr(command, "commands", {}).values():
        arranged(inner)
    return command


def first_sentence(text: str) -> str:
    """What comes before the first stop, colon or semicolon."""
    return re.split(r"[.:;](?:\s|$)", " ".join(text.split()), maxsplit=1)[0]
