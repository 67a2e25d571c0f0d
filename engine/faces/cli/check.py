"""`cellwright check` and `cellwright schema`."""

from enum import StrEnum
from typing import Annotated

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.exits import BAD_INPUT, FINDINGS
from cellwright.engine.faces.cli.options import Format, Target

NoReach = Annotated[bool, Option("--no-reach", help="do not check which places of the cell the arms reach")]


def check(target: Target, no_reach: NoReach = False, format: Format = Form.TEXT) -> None:
    """Report all errors in TARGET: in files, names, types, rules, grounded problems, the cell and the fault base."""
    give(lambda: _check(target, not no_reach), format)


def _check(target: str, reach: bool) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.report.findings import summary
    from cellwright.engine.pipelines import checking
    from cellwright.kb.diagnostics import errors

    report = checking.check(target, reach)
    found = report.diagnostics
    code = BAD_INPUT if errors(found) else FINDINGS if found else 0
    said = f"{summary(found)} in {len(report.checked)} file{'' if len(report.checked) == 1 else 's'}"
    status = "errors" if code == BAD_INPUT else "warnings" if found else "ok"
    return Answer(status, {"checked": list(report.checked)}, lambda: Text(said), code, found)


class SchemaKind(StrEnum):
    """The kinds of files that have a schema."""

    DOMAIN = "domain"
    PROBLEM = "problem"
    PLAN = "plan"
    CELL = "cell"
    ARM = "arm"
    FAULTS = "faults"
    CONTACTS = "contacts"
    SCENE = "scene"
    DEVICE = "device"
    EVENTS = "events"


def schema(kind: Annotated[SchemaKind, Argument(help="the kind of file")]) -> None:
    """Print the JSON Schema of a kind of file, for editors."""
    give(lambda: _schema(kind), Form.TEXT)


def _schema(kind: SchemaKind) -> Answer:
    import json

    from cellwright.kb.schema import json_schema

    return Answer("ok", raw=json.dumps(json_schema(kind.value), indent=1) + "\n")
