"""The verbs of the command line. Each is imported only when it is called, so that no verb waits for the modules of another."""

import sys
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise
from typing import Any

import typer
from typer.core import TyperGroup

from engine.faces.cli.answers import refuse, writing
from engine.faces.cli.idle import IdleOption
from engine.faces.cli.limited import limited
from engine.faces.cli.purposes import VERBS_FOR, arranged

USAGE: Any = typer.BadParameter.__base__  # a wrong command line; typer has no public name for it

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


class Verbs(TyperGroup):
    """The group of all verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _LazyCommands(self.commands)

    def main(self, *arguments: Any, **settings: Any) -> Any:
        """Run the command line. A page of help can also fail on a full disk."""
        try:
            with writing():
                return super().main(*arguments, **settings)
        except typer.Exit as unwritten:
            sys.exit(unwritten.exit_code)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments before the verb, and note whether the command line asks for JSON."""
        ctx.meta["json"] = (
            any(two == ("--format", "json") for two in pairwise(args)) or "--format=json" in args
        )
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        with _escaping():
            return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - the context is part of the protocol
        """All verbs, in the order of their purposes."""
        return [verb for verbs in VERBS_FOR.values() for verb in verbs]

    def invoke(self, ctx: Any) -> Any:
        """Run the verb. If JSON was asked for, a wrong command line is reported as JSON, too."""
        try:
            with _escaping():
                return super().invoke(ctx)
        except USAGE as wrong:
            if not ctx.meta["json"]:
                raise
            code = "K408" if isinstance(wrong, IdleOption) else "K407"
            refuse(wrong.format_message(), wrong.ctx.command_path if wrong.ctx else "cellwright", code)


@contextmanager
def _escaping() -> Iterator[None]:
    """A context in which no message about the command line repeats what would command the terminal."""
    try:
        yield
    except USAGE as wrong:
        from kb.diagnostics import escaped

        wrong.message = escaped(wrong.message)
        raise


class _LazyCommands(MutableMapping[str, Any]):
    """Commands by name, made when they are first asked for."""

    def __init__(self, made: MutableMapping[str, Any]) -> None:
        self._made = made

    def __getitem__(self, name: str) -> Any:
        if name not in self._made and name in VERBS:
            self._made[name] = _command(name)
        return self._made[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._made[name] = command

    def __delitem__(self, name: str) -> None:
        del self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**VERBS, **self._made})

    def __len__(self) -> int:
        return len({**VERBS, **self._made})


def _limit(group: typer.Typer, verb: str) -> None:
    for command in group.registered_commands:
        if command.callback is not None:
            command.callback = limited(command.callback, f"{verb} {command.name}")
    for each in group.registered_groups:
        if each.typer_instance is not None:
            _limit(each.typer_instance, verb)


def _command(name: str) -> Any:
    module, _, attribute = VERBS[name].partition(":")
    found = getattr(import_module(f"engine.faces.cli.{module}"), attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(limited(found, name))
        found = alone
    else:
        _limit(found, name)
    made = typer.main.get_command(found)
    made.name = name
    return arranged(made, name)
