"""Domains, and golden texts beside these tests, rewritten by `--update-golden`."""

from collections.abc import Callable
from pathlib import Path

import pytest

from kb.loader import load_domain
from kb.model.domain import Domain

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture(scope="session")
def themse() -> Domain:
    return load_domain("themse")


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compare a text with the golden file of that name."""

    def compare(name: str, text: str) -> None:
        path = GOLDEN / name
        if request.config.getoption("--update-golden", default=False):
            path.write_text(text, "utf-8")
        assert path.is_file(), f"no golden file {name}; it would hold:\n{text}"
        assert text == path.read_text("utf-8")

    return compare
