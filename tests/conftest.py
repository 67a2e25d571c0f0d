"""What tests of every folder share: texts that people read, compared whole with golden files."""

import gc
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from costs import Costs
from golden_texts import compare_with_golden
from hypothesis import is_hypothesis_test, settings
from shares import shorten

Golden = Callable[[str, str], None]
TOP = Path(__file__).parent
STARTED = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="accept changed texts as golden files"
    )
    parser.addoption(
        "--begin-within",
        type=float,
        metavar="S",
        help="skip tests whose turn comes after S seconds",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Costs(), "costs")
    if not config.getoption("--hypothesis-profile"):
        settings.register_profile("ours", settings.default, deadline=None)  # no test is timed
        settings.load_profile("ours")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Laws try fewer examples in the quick suite.

    One law may be several tests, one for each parameter.
    """
    if "not slow" in config.option.markexpr:
        functions = {item.obj for item in items if isinstance(item, pytest.Function)}
        for law in filter(is_hypothesis_test, functions):
            shorten(law)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """No test begins when the time for it is over."""
    within = item.config.getoption("--begin-within")
    if within is not None and time.monotonic() - STARTED > within:
        pytest.skip("no time is left for it")


def pytest_collection_finish() -> None:
    """The tests themselves stay for the whole run: Python need not look through them for
    garbage again and again.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 50)


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Golden:
    """`golden(name, text)` compares a text with `golden/name` beside the test, or under
    `tests/golden` when there is one.

    `--update-golden` rewrites the file, which is refused in continuous integration.
    """
    beside = request.path.parent / "golden"
    return lambda name, text: compare_with_golden(
        (beside if beside.is_dir() else TOP / "golden") / name,
        text,
        request.config.getoption("--update-golden"),
    )
