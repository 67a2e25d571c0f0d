"""Options that would change nothing are refused, with the option named: nobody believes that
they were heard.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from tests.places import BUNDLED


def refused(arguments: tuple[str, ...]) -> str:
    """The message that a program is given; people get the same one on standard error."""
    result = CliRunner().invoke(app, [*arguments])
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    return " ".join(result.stderr.replace("│", " ").split())


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plans") / "plan.json"
    file.write_text(
        CliRunner().invoke(app, ["plan", "bulkhead/one_point", "--format", "json"]).stdout
    )
    return file


@pytest.mark.parametrize(
    ("words", "idle"),
    [
        ("plan a --race --strategy asp", "--strategy"),
        ("plan a --folded", "--store"),
        ("plan a --folded --store b --format dot", "--folded"),
        ("plan a --stats --format svg", "--stats"),
        ("plan a b --pddl --goals c", "--goals"),
        ("plan a b --pddl --command c", "--command"),
        ("validate a --goals b", "--goals"),
        ("validate a --command b", "--command"),
        ("validate a --ground", "--ground"),
        ("validate a --export b --problem c", "--problem"),
        ("validate a b c --pddl --problem d", "--problem"),
        ("validate a b c --pddl --export d", "--pddl"),
        ("explain a 1 --goals b", "--goals"),
        ("explain a 1 --command b", "--command"),
        ("schedule a --stats --format svg", "--stats"),
        ("sequence a --closed --open", "closed or open"),
        ("sequence a --next", "--next"),
        ("sequence a --done m1", "--done"),
        ("sequence a --store b --cost joints", "--cost"),
        ("sequence a --store b --format svg", "--format svg"),
        ("sequence a --cost joints --method exact", "--method"),
        ("sequence a --cost joints --format svg", "--format svg"),
        ("sequence a --cost joints --open", "--open"),
        ("cell show a --output b", "--output"),
        ("cell show a --format gltf --azimuth 3", "--azimuth"),
        ("cell show a --elevation 3", "--elevation"),
        ("import qif a.csv --edge-distance 2", "--edge-distance"),
        ("diagnose a --history --exception b", "--exception"),
        ("diagnose a --reset --tree", "--tree"),
        ("diagnose a --exception b --done 1", "--plan"),
        ("diagnose a --exception b --format svg", "--tree"),
        ("diagnose a --exception b --tree --outcomes c=d", "--outcomes"),
        ("diagnose a --exception b --tree --recover", "--recover"),
        ("diagnose a --exception b --explain --hidden c", "--hidden"),
        ("diagnose a --exception b --outcomes c=d --hidden e", "--hidden"),
    ],
)
def test_an_option_without_effect_is_refused_before_anything_is_read(words: str, idle: str) -> None:
    assert idle in refused(tuple(words.split()))


@pytest.mark.parametrize("option", ["--goals", "--command"])
def test_a_plan_is_scheduled_with_its_own_goals(plan_file: Path, option: str) -> None:
    assert f"{option} has no effect on a plan" in refused(("schedule", str(plan_file), option, "x"))


def test_a_shop_has_no_goals_and_a_problem_no_instances(tmp_path: Path) -> None:
    shop = tmp_path / "shop.txt"
    shop.write_text("1 2\n0 3 1 4\n")
    assert CliRunner().invoke(app, ["schedule", str(shop)]).exit_code == 0
    assert "--goals has no effect on a shop" in refused(("schedule", str(shop), "--goals", "x"))
    assert "--instance has no effect" in refused(
        ("schedule", "bulkhead/one_point", "--instance", "ft06")
    )


@pytest.mark.parametrize("verb", ["explain", "plan", "check", "export pddl"])
def test_a_plan_in_the_place_of_a_problem_is_told_by_what_it_is(plan_file: Path, verb: str) -> None:
    result = CliRunner().invoke(app, [*verb.split(), str(plan_file), "--format", "json"])
    told: list[dict[str, Any]] = json.loads(result.stdout)["diagnostics"]
    assert [each["message"] for each in told] == ["this is an answer, not a domain or a problem"]
    assert "explained (with the number of a step)" in str(told[0])


@pytest.mark.parametrize("kind", ["cell", "faults"])
def test_a_file_beside_the_domain_is_told_by_what_it_is(kind: str) -> None:
    file = BUNDLED / "bulkhead" / f"{kind}.yaml"
    result = CliRunner().invoke(app, ["plan", str(file)])
    assert result.exit_code == 2
    assert result.stderr.count("error") == 1
    assert "not a domain or a problem" in result.stderr
