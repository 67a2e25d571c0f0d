"""`plan --robust` and `run --robust` on the command line."""

import json
from pathlib import Path

from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.process.exit_codes import BAD_INPUT, FINDINGS
from tests.engine.pipelines.planning.robustness.uncertain_cells import write_oven

run = CliRunner().invoke
HEAT = "{from: 60 s, to: 75 s}"


def test_a_plan_with_a_policy_has_its_rules_as_data(tmp_path: Path) -> None:
    cell = write_oven(tmp_path, stay=75, heat=HEAT)
    answer = run(app, ["plan", str(cell), "--robust", "--format", "json"])
    assert answer.exit_code == 0
    robustness = json.loads(answer.stdout)["data"]["robustness"]
    assert robustness["robust"] is True
    assert [rule["step"] for rule in robustness["policy"]] == [1, 2, 3]


def test_a_plan_without_a_policy_is_a_finding_and_no_run_begins(tmp_path: Path) -> None:
    cell = write_oven(tmp_path, stay=70, heat=HEAT)
    answer = run(app, ["plan", str(cell), "--robust"])
    assert answer.exit_code == FINDINGS
    assert "Not robust" in answer.stdout
    refused = run(app, ["run", str(cell), "--robust", "--store", str(tmp_path / "runs.db")])
    assert refused.exit_code == BAD_INPUT
    assert "K421" in refused.stderr


def test_options_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    cell = str(write_oven(tmp_path, stay=75, heat=HEAT))
    for more in (["--motion"], ["--objective", "cost"]):
        assert run(app, ["plan", cell, "--robust", *more]).exit_code == BAD_INPUT
    for verb in ("plan", "run"):
        alone = run(app, [verb, cell, "--durations-from", "runs.db"])
        assert alone.exit_code == BAD_INPUT
    drawn = ["run", cell, "--store", str(tmp_path / "r.db"), "--option", "durations=some"]
    assert "K406" in run(app, drawn).stderr


def test_a_run_with_a_policy_ends_well(tmp_path: Path) -> None:
    cell = write_oven(tmp_path, stay=75, heat=HEAT)
    words = ["run", str(cell), "--robust", "--store", str(tmp_path / "runs.db")]
    answer = run(app, [*words, "--option", "durations=longest"])
    assert answer.exit_code == 0
    assert "0 exceptions" in answer.stdout
