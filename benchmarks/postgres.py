"""A PostgreSQL server of our own, from Debian's package, for tests and benchmarks."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda p: int(p.parent.name))


@dataclass(frozen=True)
class Server:
    """A server on a socket in a folder of its own. It can be killed and started again."""

    folder: Path
    settings: str
    environment: Mapping[str, str]
    account: str | None  # the server refuses to run as root

    @property
    def url(self) -> str:
        """Where it is reached."""
        return f"postgresql://cell@/postgres?host={self.folder}"

    @property
    def _data(self) -> Path:
        return self.folder / "data"

    def make(self) -> None:
        """Make its folder of data."""
        self._run("initdb", "-D", str(self._data), "-A", "trust", "-U", "cell", "--no-sync")

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-c listen_addresses='' -k {self.folder} {self.settings}"
        log = str(self.folder / "log")
        self._run(
            "pg_ctl",
            "-D",
            str(self._data),
            "-o",
            options,
            "-l",
            log,
            "-w",
            "start",
            **self.environment,
        )

    @property
    def process(self) -> int:
        """Its first process, which starts one for each connection."""
        return int((self._data / "postmaster.pid").read_text().split()[0])

    def kill(self, how: signal.Signals) -> None:
        """Send its first process a signal: SIGQUIT ends all, SIGKILL leaves the others to
        notice it.
        """
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.process, how)

    def _run(self, program: str, *arguments: str, **more: str) -> None:
        subprocess.run(
            [PROGRAMS[-1] / program, *arguments],
            check=True,
            user=self.account,
            cwd="/",
            capture_output=True,
            env={**os.environ, **more},
        )


@contextlib.contextmanager
def server(
    settings: str = "-c fsync=off", environment: Mapping[str, str] | None = None
) -> Iterator[Server]:
    """A server that runs. `{data}` in the environment is the folder of its data."""
    account = "postgres" if os.getuid() == 0 else None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if account:
            shutil.chown(folder, account)
        told = {
            key: value.format(data=folder / "data") for key, value in (environment or {}).items()
        }
        made = Server(folder, settings, told, account)
        made.make()
        made.start()
        try:
            yield made
        finally:
            made.kill(signal.SIGQUIT)  # immediate shutdown


@contextlib.contextmanager
def served(
    settings: str = "-c fsync=off", environment: Mapping[str, str] | None = None
) -> Iterator[str]:
    """The URL of a server that runs."""
    with server(settings, environment) as made:
        yield made.url


def emptied(url: str) -> None:
    """Throw away everything in the database."""
    from sqlalchemy import text

    from cellwright.kb.store.database import connect_engine

    engine = connect_engine(url)
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA public CASCADE"))
        connection.execute(text("CREATE SCHEMA public"))
    engine.dispose()
