"""Libraries to test: a SQLite file, and a PostgreSQL server where one is installed."""

import contextlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from multiprocessing.context import BaseContext
from pathlib import Path

import pytest

PROGRAMS = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda p: int(p.parent.name))


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """The URL of a server of our own, on a socket in a folder of our own."""
    pytest.importorskip("pg8000", reason="the extra 'postgres' is not installed")
    if not PROGRAMS:
        pytest.skip("PostgreSQL is not installed")
    programs = PROGRAMS[-1]
    account = "postgres" if os.getuid() == 0 else None  # the server refuses to run as root

    def run(program: str, *arguments: str) -> None:
        subprocess.run(
            [programs / program, *arguments], check=True, user=account, cwd="/", capture_output=True
        )

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if account:
            shutil.chown(folder, account)
        data = folder / "data"
        run("initdb", "-D", str(data), "-A", "trust", "-U", "cell", "--no-sync")
        options = f"-c listen_addresses='' -k {folder} -c fsync=off"
        run("pg_ctl", "-D", str(data), "-o", options, "-l", str(folder / "log"), "-w", "start")
        process = int((data / "postmaster.pid").read_text().split()[0])
        try:
            yield f"postgresql://cell@/postgres?unix_sock={folder}/.s.PGSQL.5432"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGQUIT)  # immediate shutdown


@pytest.fixture(scope="session")
def processes() -> BaseContext:
    """Starts processes that share nothing with this one. What all of them load is loaded once."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["kb.store.library", "pytest", "macrops"])
    return context


@pytest.fixture(params=["sqlite", "postgres"])
def target(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where a library can be kept, empty."""
    if request.param == "sqlite":
        return str(tmp_path / "library.db")
    url = str(request.getfixturevalue("postgres"))
    _emptied(url)
    return url


def _emptied(url: str) -> None:
    from sqlalchemy import text

    from kb.store.engines import connected

    engine = connected(url)
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA public CASCADE"))
        connection.execute(text("CREATE SCHEMA public"))
    engine.dispose()
