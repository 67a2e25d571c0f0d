"""The command line as an application of typer: help, completion, and whatever is no plain line (`plain_lines`)."""

from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from cellwright.engine.faces.cli.answers import refuse, writing
from cellwright.engine.faces.cli.declared import WRONG
from cellwright.engine.faces.cli.limited import limited
from cellwright.engine.faces.cli.purposes import VERBS_FOR, arranged
from cellwright.engine.faces.cli.verbs import VERBS, verb

USAGE: Any = typer.BadParameter.__base__  # a wrong command line; typer has no public name for it


class Verbs(TyperGroup):
    """The group of all verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _LazyCommands(self.commands)

    def main(self, *arguments: Any, **settings: Any) -> Any:
        """Run the command line. A page of help can also fail on a full disk."""
        with writing():
            return super().main(*arguments, **settings)

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
            code = vars(wrong).get("code", WRONG)
            refuse(wrong.format_message(), wrong.ctx.command_path if wrong.ctx else "cellwright", code)


@contextmanager
def _escaping() -> Iterator[None]:
    """A context in which no message about the command line repeats what would command the terminal."""
    try:
        yield
    except USAGE as wrong:
        from cellwright.kb.diagnostics import escaped

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


def _limit(group: typer.Typer, name: str) -> None:
    for command in group.registered_commands:
        if command.callback is not None:
            command.callback = limited(command.callback, f"{name} {command.name}")
    for each in group.registered_groups:
        if each.typer_instance is not None:
            _limit(each.typer_instance, name)


def _command(name: str) -> Any:
    found = verb(name)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(limited(found, name))
        found = alone
    else:
        _limit(found, name)
    made = typer.main.get_command(found)
    made.name = name
    return arranged(made, name)


app = typer.Typer(
    name="cellwright",
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"cellwright {version('cellwright')}")
        raise typer.Exit


@app.callback()
def cellwright(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    """Plan and diagnose for robot work cells."""
