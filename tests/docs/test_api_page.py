"""Every example of the Python interface runs, in the order of the page."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "api.md").read_text()
EXAMPLES = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)


# each takes seconds
LONG = ("explain(", ".diagnose(", ".run(", ".cell(", ".place(", ".prepare(", ".init(")


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_examples_run_one_after_another(
    whole: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(EXAMPLES) >= 6
    names: dict[str, object] = {}
    for example in (
        EXAMPLES if whole else [each for each in EXAMPLES if not any(long in each for long in LONG)]
    ):
        exec(compile(example, "api.md", "exec"), names)
