"""What tests of every folder share: texts that people read, compared whole with golden files."""

import gc
from collections.abc import Callable
from pathlib import Path

import pytest
from costs import Costs
from golden_texts import compare_with_golden
from hypothesis import settings

Golden = Callable[[str, str], None]
TOP = Path(__file__).parent
QUICK = 40  # examples of a law that names no number; `make laws` and the slow suite try 100


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="accept changed texts as golden files")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Costs(), "costs")
    if not config.getoption("--hypothesis-profile"):
        quick = {"max_examples": QUICK} if "not slow" in config.option.markexpr else {}
        settings.register_profile("ours", settings.default, deadline=None, **quick)  # no test is timed
        settings.load_profile("ours")


def pytest_collection_finish() -> None:
    """The tests themselves stay for the whole run: Python need not look through them for garbage again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 50)


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Golden:
    """`golden(name, text)` compares a text with `golden/name` beside the test, or under `tests/golden` when there is one.

    `--update-golden` rewrites the file, which is refused in continuous integration.
    """
    beside = request.path.parent / "golden"
    return lambda name, text: compare_with_golden(
        (beside if beside.is_dir() else TOP / "golden") / name,
        text,
        request.config.getoption("--update-golden"),
    )
