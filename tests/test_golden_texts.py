from pathlib import Path

import pytest
from golden_texts import compare_with_golden


@pytest.fixture
def accepted(tmp_path: Path) -> Path:
    (tmp_path / "name.txt").write_text("as it was")
    return tmp_path / "name.txt"


def test_a_text_that_differs_from_its_golden_file_fails(accepted: Path) -> None:
    compare_with_golden(accepted, "as it was", update=False)
    with pytest.raises(AssertionError):
        compare_with_golden(accepted, "as it is", update=False)


def test_a_text_without_a_golden_file_fails(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no golden file"):
        compare_with_golden(tmp_path / "new.txt", "text", update=False)


def test_accepting_rewrites_the_golden_file(
    accepted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CI", raising=False)
    compare_with_golden(accepted, "as it is", update=True)
    assert accepted.read_text() == "as it is"


def test_nothing_is_accepted_in_continuous_integration(
    accepted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match="continuous integration"):
        compare_with_golden(accepted, "as it is", update=True)
    assert accepted.read_text() == "as it was"
