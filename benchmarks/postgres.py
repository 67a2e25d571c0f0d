"""A PostgreSQL server of our own, from Debian's package, for tests and benchmarks."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

PROGRAMS = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda p: int(p.parent.name))


@contextlib.contextmanager
def served(settings: str = "-c fsync=off", environment: Mapping[str, str] | None = None) -> Iterator[str]:
    """The URL of a server on a socket in a folder of its own. `{data}` in the environment is the folder of its data."""
    programs = PROGRAMS[-1]
    account = "postgres" if os.getuid() == 0 else None  # the server refuses to run as root

    def run(program: str, *arguments: str, **more: str) -> None:
        subprocess.run(
            [programs / program, *arguments],
            check=True,
            user=account,
            cwd="/",
            capture_output=True,
            env={**os.environ, **more},
        )

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if account:
            shutil.chown(folder, account)
        data = folder / "data"
        run("initdb", "-D", str(data), "-A", "trust", "-U", "cell", "--no-sync")
        options = f"-c listen_addresses='' -k {folder} {settings}"
        told = {key: value.format(data=data) for key, value in (environment or {}).items()}
        run("pg_ctl", "-D", str(data), "-o", options, "-l", str(folder / "log"), "-w", "start", **told)
        process = int((data / "postmaster.pid").read_text().split()[0])
        try:
            yield f"postgresql://cell@/postgres?unix_sock={folder}/.s.PGSQL.5432"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGQUIT)  # immediate shutdown


def emptied(url: str) -> None:
    """Throw away everything in the database."""
    from sqlalchemy import text

    from kb.store.engines import connected

    engine = connected(url)
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA public CASCADE"))
        connection.execute(text("CREATE SCHEMA public"))
    engine.dispose()
