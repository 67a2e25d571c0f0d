import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

run = CliRunner().invoke


def answer(*arguments: str) -> tuple[int, dict[str, Any]]:
    """The exit code and the envelope of a command asked for JSON."""
    result = run(app, [*arguments, "--format", "json"])
    return result.exit_code, json.loads(result.stdout)


@pytest.mark.parametrize("options", [[], ["--ground"], ["--goals", "measured(_, _, meas(m1))"]])
def test_an_export_is_planned_and_its_plan_checked(tmp_path: Path, options: list[str]) -> None:
    code, envelope = answer("export", "pddl", "bulkhead/one_point", "-o", str(tmp_path), *options)
    assert (code, envelope["data"]["lifted"]) == (0, "--ground" not in options)
    files = [envelope["data"]["domain"], envelope["data"]["problem"]]
    plan = run(app, ["plan", "--pddl", *files, "--format", "ipc"]).stdout
    (tmp_path / "sas_plan").write_text(plan)
    code, envelope = answer(
        "validate", "--export", "bulkhead/one_point", str(tmp_path / "sas_plan"), *options
    )
    assert (code, envelope["status"]) == (0, "valid")
    (tmp_path / "sas_plan").write_text("\n".join(plan.splitlines()[1:]))
    code, envelope = answer(
        "validate", "--export", "bulkhead/one_point", str(tmp_path / "sas_plan"), *options
    )
    assert (code, envelope["status"]) == (1, "invalid")


def test_an_export_replaces_an_export_and_nothing_else(tmp_path: Path) -> None:
    line = ["export", "pddl", "bulkhead/one_point", "-o", str(tmp_path)]
    assert answer(*line)[0] == answer(*line)[0] == 0
    (tmp_path / "domain.pddl").write_text("(define (domain precious))\n")
    code, envelope = answer(*line)
    assert (code, envelope["diagnostics"][0]["code"]) == (2, "K403")
    assert (tmp_path / "domain.pddl").read_text() == "(define (domain precious))\n"


def test_a_folder_that_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        code, envelope = answer("export", "pddl", "bulkhead/one_point", "-o", str(folder))
        assert (code, envelope["diagnostics"][0]["code"]) == (2, "K415")
        assert "cannot be written" in envelope["diagnostics"][0]["message"]
