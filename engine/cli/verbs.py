"""The verbs of the command line, each imported when it is called: what one needs, the others do not wait for."""

from collections.abc import Iterator, MutableMapping
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

VERBS = {
    "cell": "cell:app",
    "check": "check:check",
    "diagnose": "diagnose:diagnose",
    "explain": "explain:explain",
    "export": "export:export",
    "import": "import_:app",
    "init": "init:init",
    "macros": "macros:app",
    "measurement": "measurement:app",
    "plan": "plan:plan",
    "prepare": "prepare:prepare",
    "revise": "revise:revise",
    "schedule": "schedule:schedule",
    "schema": "check:schema",
    "sequence": "sequence:sequence",
    "test": "golden:golden_plans",
    "validate": "plan:validate",
}
"""Name of a verb, and the module and function (or group of verbs) that it is."""


class Verbs(TyperGroup):
    """The group of all verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Loaded(self.commands)


class _Loaded(MutableMapping[str, Any]):
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


def _command(name: str) -> Any:
    module, _, attribute = VERBS[name].partition(":")
    found = getattr(import_module(f"engine.cli.{module}"), attribute)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        alone.command(name)(found)
        found = alone
    made = typer.main.get_command(found)
    made.name = name
    return made
