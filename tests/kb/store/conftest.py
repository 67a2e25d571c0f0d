"""Libraries to test: a SQLite file, and a PostgreSQL server where one is installed."""

import multiprocessing
from collections.abc import Iterator
from multiprocessing.context import BaseContext
from pathlib import Path

import pytest

from benchmarks.postgres import PROGRAMS, emptied, served


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """The URL of a server of our own, on a socket in a folder of our own."""
    pytest.importorskip("psycopg", reason="the extra 'postgres' is not installed")
    if not PROGRAMS:
        pytest.skip("PostgreSQL is not installed")
    with served() as url:
        yield url


@pytest.fixture(scope="session")
def processes() -> BaseContext:
    """Starts processes that share nothing with this one. What all of them load is loaded once."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["cellwright.kb.store.macrop_library", "pytest", "macrops"])
    return context


@pytest.fixture(params=["sqlite", "postgres"])
def target(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where a library can be kept, empty."""
    if request.param == "sqlite":
        return str(tmp_path / "library.db")
    url = str(request.getfixturevalue("postgres"))
    emptied(url)
    return url
