"""The tutorial, gone through as a reader would: each file written, each command line run, each
output and picture compared.
"""

import re
from pathlib import Path

import pytest
from golden_texts import compare_with_golden

from tests.docs.pages import PATHS, TOP, Run, Written, assert_shown, parts, run

(TUTORIAL,) = (path for path in PATHS if path.name == "tutorial.md")
PAGE = TUTORIAL.read_text("utf-8")
PICTURE = re.compile(r"!\[[^\]]*\]\(tutorial/([^)]+)\)")


@pytest.mark.slow
def test_the_tutorial_goes_as_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(tmp_path)
    update = request.config.getoption("--update-golden")
    results = {}
    for part in parts(PAGE):
        if isinstance(part, Written):
            _write(part)
            continue
        results[part] = run(part.line)
        if part.shown is None:
            assert results[part].exit_code == 0, (part.line, results[part].output)
        assert results[part].exit_code in (0, 1, 2), (part.line, results[part].output)
    assert_shown(TUTORIAL, results, update)
    for file in PICTURE.findall(PAGE):
        compare_with_golden(TOP / "docs" / "tutorial" / file, Path(file).read_text("utf-8"), update)


def _write(part: Written) -> None:
    path = Path(part.path)
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.read_text("utf-8") if part.added else ""
    path.write_text(before + part.text, "utf-8")


def test_the_tutorial_has_what_a_reader_has_to_see() -> None:
    runs = [part for part in parts(PAGE) if isinstance(part, Run)]
    verbs = {part.line.split()[1] for part in runs}
    assert {"init", "check", "plan", "schedule", "diagnose", "run", "results"} <= verbs
    assert any("--fault" in part.line and part.shown for part in runs)
    assert len(PICTURE.findall(PAGE)) >= 2
    assert {path.name for path in (TOP / "docs" / "tutorial").iterdir()} == set(
        PICTURE.findall(PAGE)
    )
