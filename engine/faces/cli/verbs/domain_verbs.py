"""The verbs for files of a domain: `check`, `schema`, `format`, `init` and `test`."""

import json
import os
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.faces.cli.options.shared_options import Format, Target
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import BAD_INPUT, FINDINGS, INTERRUPTED
from cellwright.engine.faces.cli.process.process_limits import current_watch
from cellwright.engine.faces.cli.process.progress_line import tell_progress
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import report as reports
from cellwright.engine.formats.report import rich_parts
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, select_errors
from cellwright.kb.stopping import StoppedByCaller

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.authoring.testing.golden_files import GoldenComparison

NoReach = Annotated[
    bool, Option("--no-reach", help="do not check_target which places of the cell the arms reach")
]


def check_target(
    target: Target, no_reach: NoReach = False, format: Format = AnswerForm.TEXT
) -> None:
    """Report all errors in TARGET: in files, names, types, rules, grounded problems, the cell
    and the fault base.
    """
    give_answer(lambda: _check_target(target, not no_reach), format)


def _check_target(target: str, reach: bool) -> VerbAnswer:
    from cellwright.engine.authoring import domain_check

    report = domain_check.check_domain_files(target, reach)
    check_findings = report.diagnostics
    code = BAD_INPUT if select_errors(check_findings) else FINDINGS if check_findings else 0
    summary_line = (
        f"{reports.diagnostics_summary(check_findings)} in {len(report.checked)} "
        f"file{'' if len(report.checked) == 1 else 's'}"
    )
    status = "errors" if code == BAD_INPUT else "warnings" if check_findings else "ok"
    return VerbAnswer(
        status,
        {"checked": list(report.checked)},
        lambda: rich_parts.Text(summary_line),
        code,
        check_findings,
    )


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


def print_schema(kind: Annotated[SchemaKind, Argument(help="the kind of file")]) -> None:
    """Print the JSON Schema of a kind of file, for editors."""
    give_answer(lambda: _schema_answer(kind), AnswerForm.TEXT)


def _schema_answer(kind: SchemaKind) -> VerbAnswer:
    from cellwright.kb.schema import json_schema

    return VerbAnswer("ok", raw=json.dumps(json_schema(kind.value), indent=1) + "\n")


Files = Annotated[
    list[Path],
    Argument(
        metavar="FILE...", help="files, or folders of which every .yaml and .lp file is taken"
    ),
]
Check = Annotated[
    bool, Option("--check", help="write nothing; exit with 1 if a file has another form")
]


def format_domain_files(
    files: Files, check: Check = False, format: Format = AnswerForm.TEXT
) -> None:
    """Give FILEs their usual indentation and spaces.

    Comments and meaning stay. A broken file is left as it is.
    """
    give_answer(lambda: _format_files(files, check), format)


def _format_files(files: list[Path], check: bool) -> VerbAnswer:
    from cellwright.engine.authoring.layout import arrange_files

    arranged_files = arrange_files(files, write=not check)
    code = (
        BAD_INPUT
        if arranged_files.findings
        else FINDINGS
        if check and arranged_files.changed
        else 0
    )
    verb = "would change" if check else "changed"
    unchanged_count = arranged_files.looked_at - len(arranged_files.changed) - arranged_files.broken
    lines = [f"{verb} {changed_file}" for changed_file in arranged_files.changed]
    lines.append(
        f"{len(arranged_files.changed)} {verb}, {unchanged_count} already in form"
        + (f", {arranged_files.broken} broken" if arranged_files.broken else "")
    )
    content = {"changed": list(arranged_files.changed), "files": arranged_files.looked_at}
    status = "bad input" if code == BAD_INPUT else "changes" if arranged_files.changed else "ok"
    return VerbAnswer(
        status, content, lambda: rich_parts.Text("\n".join(lines)), code, arranged_files.findings
    )


def init_domain(
    folder: Annotated[Path, Argument(help="a folder that is new or empty")],
    with_: Annotated[
        str | None,
        Option(
            "--with",
            metavar="DEVICES",
            help="put it together from devices: furnace,drawer,balance; hotel=rack gives one a "
            "name",
            autocompletion=shared_options.complete_devices,
        ),
    ] = None,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write a small commented domain into FOLDER, with problems, a fault base and a golden plan."""
    devices = [
        device_name.strip() for device_name in (with_ or "").split(",") if device_name.strip()
    ]
    if with_ is not None and not devices:
        raise make_misfit("it names no device; `devices list` has their names", param_hint="--with")
    give_answer(
        lambda: _assemble_domain(folder, devices) if devices else _write_domain(folder), format
    )


def _write_domain(folder: Path) -> VerbAnswer:
    from cellwright.engine.authoring.starter import create_domain

    verbs = (
        f"check {folder}",
        f"plan {folder}/problems/two_items.yaml",
        f"test {folder}",
        f"diagnose {folder} --exception not_gripped --tree",
    )
    return _init_answer(map(str, create_domain(folder)), verbs)


def _assemble_domain(folder: Path, devices: list[str]) -> VerbAnswer:
    from cellwright.engine.authoring.starter import create_with

    written, faults = create_with(folder, devices)
    problem = f"{folder}/problems/first.yaml"
    failing = [f"run {problem} --fault {faults[-1]}"] if faults else []
    verbs = (f"check {folder}", f"plan {problem}", f"run {problem}", *failing, f"test {folder}")
    return _init_answer(map(str, written), verbs)


def _init_answer(files: Iterable[str], verbs: Iterable[str]) -> VerbAnswer:
    written = list(files)
    advice = ["try", *(f"  cellwright {verb}" for verb in verbs)]
    return VerbAnswer(
        "ok", {"written": written}, lambda: rich_parts.Text("\n".join([*written, *advice]))
    )


def golden_plans(
    target: Target,
    update: Annotated[bool, Option("--update", help="accept the answers as they are now")] = False,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Plan every problem of TARGET again and compare the answer with its golden file."""
    give_answer(lambda: _test_golden_plans(target, update), format)


def _test_golden_plans(target: str, update: bool) -> VerbAnswer:
    from cellwright.engine.authoring.testing import golden_files

    if update and os.environ.get("CI"):
        hint = "run it on your machine, read the differences, and commit the golden files"
        golden_diagnostic = Diagnostic(
            Source("--update"),
            "K403",
            "golden files are not rewritten in continuous integration",
            hint,
        )
        raise InvalidInput([golden_diagnostic])
    compared: list[GoldenComparison] = []
    begun: list[str] = []

    def begin(name: str) -> None:
        begun.append(name)
        tell_progress(name)

    try:
        compared += golden_files.compare_all(target, begin)
    except (KeyboardInterrupt, StoppedByCaller):
        if (watch := current_watch()) and watch.short:
            raise
        return _interrupted(compared, begun[-1] if begun else "")
    if update:
        for comparison in compared:
            if comparison.verdict != "same":
                golden_files.accept_answer(comparison)
    content = {"updated": update, "unfinished": "", "problems": list(map(_golden_entry, compared))}
    agreed = update or all(comparison.verdict == "same" for comparison in compared)
    return VerbAnswer(
        "same" if agreed else "different",
        content,
        lambda: _golden_text(compared, update),
        0 if agreed else FINDINGS,
    )


def _interrupted(compared: "list[GoldenComparison]", name: str) -> VerbAnswer:
    """The answer of a test that was ended early: what is known, and which problem was being
    planned.
    """
    content = {"updated": False, "unfinished": name, "problems": list(map(_golden_entry, compared))}

    def text() -> "RenderableType":
        from rich.console import Group

        return Group(_golden_text(compared, False), f"interrupted while planning {name}")

    return VerbAnswer("interrupted", content, text, INTERRUPTED)


def _golden_entry(compared: "GoldenComparison") -> dict[str, Any]:
    return {
        "problem": compared.name,
        "verdict": compared.verdict,
        "meaning": list(compared.meaning),
        "diff": list(compared.diff),
    }


_COLOURS = {"+": "green", "-": "red", "@": "cyan"}


def _golden_text(compared: "list[GoldenComparison]", updated: bool) -> "RenderableType":
    text = rich_parts.Text()
    for comparison in compared:
        meaning_text = f": {', '.join(comparison.meaning)}" if comparison.meaning else ""
        text.append(
            f"{comparison.verdict:9} {comparison.name}{meaning_text}\n",
            "" if comparison.verdict == "same" else "bold",
        )
        for line in comparison.diff:
            text.append(f"    {line}\n", _COLOURS.get(line[0]))
    differing = sum(comparison.verdict != "same" for comparison in compared)
    if not compared:
        text.append("there are no problems to test")
    elif updated:
        text.append(f"{differing} of {len(compared)} golden files written")
    else:
        text.append(f"{len(compared) - differing} of {len(compared)} as accepted")
        text.append("; `--update` accepts the answers as they are now" if differing else "")
    return text
