"""The typer application: it reads every command line, and has help and completion."""

import re
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from cellwright.engine.faces.cli.output.answer_output import refuse_command_line, writing_output
from cellwright.engine.faces.cli.verb_table import (
    VERBS,
    VERBS_FOR,
    has_limits,
    limit_verb,
    load_verb,
)
from cellwright.engine.faces.cli.wrong_options import WRONG

OPTIONS_FOR = {
    "What is wanted": (
        "--goals", "--command", "--objective", "--order", "--window", "--lasts", "--before",
        "--margin", "--upright",
    ),
    "The answer": (
        "--format", "--output", "--stats", "--folded", "--explain", "--tree", "--events",
        "--watch", "--azimuth", "--elevation",
    ),
    "Limits": (
        "--time-limit", "--memory-limit", "--expansions", "--work", "--budget", "--bridges",
        "--refine", "--seed", "--race",
        "--anytime", "--jobs", "--cluster",
    ),
}  # fmt: skip
"""The options under each heading, wherever a command has many; all others come first."""

HEADED_OPTION_COUNT = 8  # options that need headings
_HEADING = {verb: heading for heading, verbs in VERBS_FOR.items() for verb in verbs}
_OPTION = {option: heading for heading, options in OPTIONS_FOR.items() for option in options}


def arrange_help(command: Any, verb: str = "") -> Any:
    """The same command (and those of a group) with headings, arguments in capitals and one
    sentence for lists of commands.
    """
    command.rich_help_panel = _HEADING.get(verb)
    command.short_help = first_sentence(command.help or "")
    headed = len(command.params) > HEADED_OPTION_COUNT
    for param in command.params:
        if param.param_type_name == "argument":
            param.metavar = param.metavar or param.name.upper() + (
                "..." if param.nargs != 1 else ""
            )
        elif headed:
            param.rich_help_panel = _OPTION.get(param.opts[0])
    for inner in getattr(command, "commands", {}).values():
        arrange_help(inner)
    return command


def first_sentence(text: str) -> str:
    """What comes before the first stop, colon or semicolon."""
    return re.split(r"[.:;](?:\s|$)", " ".join(text.split()), maxsplit=1)[0]


USAGE: Any = typer.BadParameter.__base__  # a wrong command line; typer has no public name for it


class Verbs(TyperGroup):
    """The group of all verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _LazyCommands(self.commands)

    def main(self, *arguments: Any, **settings: Any) -> Any:
        """Run the command line. A page of help can also fail on a full disk."""
        with writing_output():
            return super().main(*arguments, **settings)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments before the verb, and note whether the command line asks for JSON."""
        ctx.meta["json"] = (
            any(two == ("--format", "json") for two in pairwise(args)) or "--format=json" in args
        )
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        with _escaping_messages():
            return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the page of help, with the verbs in the words of their table: none is loaded."""
        self.commands = _outlines()
        super().format_help(ctx, formatter)

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - of the protocol
        """All verbs, in the order of their purposes."""
        return [verb for verbs in VERBS_FOR.values() for verb in verbs]

    def invoke(self, ctx: Any) -> Any:
        """Run the verb. If JSON was asked for, a wrong command line is reported as JSON, too."""
        try:
            with _escaping_messages():
                return super().invoke(ctx)
        except USAGE as wrong:
            if not ctx.meta["json"]:
                raise
            code = vars(wrong).get("code", WRONG)
            refuse_command_line(
                wrong.format_message(), wrong.ctx.command_path if wrong.ctx else "cellwright", code
            )


@contextmanager
def _escaping_messages() -> Iterator[None]:
    """A context in which no message about the command line repeats what would command the
    terminal.
    """
    try:
        yield
    except USAGE as wrong:
        from cellwright.kb.diagnostics import escape_controls

        wrong.message = escape_controls(wrong.message)
        raise


def _outlines() -> dict[str, Any]:
    """The verbs as far as lists of commands show them."""
    return {
        name: TyperCommand(name, short_help=verb.summary, rich_help_panel=heading)
        for heading, verbs in VERBS_FOR.items()
        for name, verb in verbs.items()
    }


class _LazyCommands(MutableMapping[str, Any]):
    """Commands by name, made when they are first asked for."""

    def __init__(self, made: MutableMapping[str, Any]) -> None:
        self._made = made

    def __getitem__(self, name: str) -> Any:
        if name not in self._made and name in VERBS:
            self._made[name] = _make_command(name)
        return self._made[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._made[name] = command

    def __delitem__(self, name: str) -> None:
        del self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**VERBS, **self._made})

    def __len__(self) -> int:
        return len({**VERBS, **self._made})


def _limit_commands(group: typer.Typer, name: str) -> None:
    for command in group.registered_commands:
        # a group may be made again in one process, and its verbs have their limits then
        if command.callback is not None and not has_limits(command.callback):
            command.callback = limit_verb(command.callback, f"{name} {command.name}")
    for registered_group in group.registered_groups:
        if registered_group.typer_instance is not None:
            _limit_commands(registered_group.typer_instance, name)


def _make_command(name: str) -> Any:
    verb_function = load_verb(name)
    if not isinstance(verb_function, typer.Typer):
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(limit_verb(verb_function, name))
        verb_function = alone
    else:
        _limit_commands(verb_function, name)
    click_command = typer.main.get_command(verb_function)
    click_command.name = name
    return arrange_help(click_command, name)


app = typer.Typer(
    name="cellwright",
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"cellwright {version('cellwright')}")
        raise typer.Exit


@app.callback()
def cellwright_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and exit"
        ),
    ] = False,
) -> None:
    """Plan and diagnose for robot work cells."""
