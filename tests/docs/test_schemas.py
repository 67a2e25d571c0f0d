"""The schemas that editors load are those of the code, and describe every key."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from golden_texts import compare_with_golden
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.kb.schema import json_schema
from cellwright.kb.schema.form_validation import find_deviations

TOP = Path(__file__).parents[2]
DOCS = TOP / "docs"
BUNDLED = [*(TOP / "domains").glob("*/domain.yaml"), *(TOP / "domains").glob("*/problems/*.yaml")]
KINDS = sorted(file.name.removesuffix(".schema.json") for file in (DOCS / "schema").iterdir())


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_is_current(kind: str, request: pytest.FixtureRequest) -> None:
    text = json.dumps(json_schema(kind), indent=1) + "\n"
    update = request.config.getoption("--update-golden")
    compare_with_golden(DOCS / "schema" / f"{kind}.schema.json", text, update)


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_has_a_description(kind: str) -> None:
    assert list(_undescribed(json_schema(kind), kind)) == []


def test_files_that_people_write_have_a_schema() -> None:
    assert {"domain", "problem", "plan"} <= set(KINDS)


@pytest.mark.parametrize(
    "file", sorted(BUNDLED), ids=lambda file: f"{file.parent.name}/{file.name}"
)
def test_a_bundled_file_names_its_schema_for_editors(file: Path) -> None:
    first = file.read_text("utf-8").partition("\n")[0]
    named = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", first)
    assert named
    kind = "domain" if file.name == "domain.yaml" else "problem"
    assert (file.parent / named[1]).resolve() == DOCS / "schema" / f"{kind}.schema.json"


def _undescribed(part: Any, path: str) -> Iterator[str]:
    if isinstance(part, dict):
        keys = part.get("properties", {})
        yield from (f"{path}/{key}" for key, value in keys.items() if not value.get("description"))
        for key, value in part.items():
            yield from _undescribed(value, f"{path}/{key}")
    elif isinstance(part, list):
        for index, value in enumerate(part):
            yield from _undescribed(value, f"{path}/{index}")


@pytest.mark.slow
def test_every_event_of_a_run_fits_the_schema_of_events(tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    line = ["run", "themse/one", "--store", str(tmp_path / "runs.db"), "--events", str(events)]
    ran = CliRunner().invoke(app, [*line, "--fault", "pick#2=not_gripped"])
    assert ran.exit_code == 0, ran.output
    lines = [json.loads(each) for each in events.read_text("utf-8").splitlines()]
    assert [each["number"] for each in lines] == list(range(1, len(lines) + 1))
    assert {"run", "plan", "command", "reply", "done", "exception", "diagnosis", "end"} <= {
        each["kind"] for each in lines
    }
    assert [each for one in lines for each in find_deviations("events", one)] == []


def test_every_kind_of_record_has_a_form() -> None:
    text = json.dumps(json_schema("events"))
    assert all(f'"const": "{kind.value}"' in text for kind in RecordKind)
