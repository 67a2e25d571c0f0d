"""What a library survives, in SQLite and in PostgreSQL: kills, full disks, damage, and writers
beside each other.

    python benchmarks/stores.py [--table kills disk damage writers] [--only sqlite postgres]
        [--kills N] [--full N] [--damage N]
                                [--writers N] [--seed N] [--json FILE]

A writer puts MACROPs, closed cases, sequences, poses and lines of a journal into a library, and
tells after each commit. `kills`: SIGKILL at a random moment. What was told is there, `store check`
finds nothing, and the next writer goes on. `disk`: a library in the preloaded `disk.c` has room for
a random number of bytes. The same must hold, and the writer ends with one diagnostic. In PostgreSQL
each connection of the server has the room. `damage`: bits, bytes and pages of a SQLite file, and
documents in rows of PostgreSQL, are spoiled. All readers answer or end with diagnostics. `writers`:
processes write at once. Everything is there, and nobody gets an error. Exits with 1 if something is
wrong.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

from postgres import PROGRAMS, emptied, served
from stores_damage import damaged, read_everything
from stores_writer import content, missing, write

SHIM = Path(__file__).parents[1] / "tests" / "kb" / "store" / "disk.c"


@dataclass
class Table:
    """What came of the trials of one kind in one kind of database."""

    name: str
    database: str
    trials: int = 0
    committed: int = 0
    ended: int = 0
    seconds: float = 0.0
    wrong: list[str] = field(default_factory=list)

    def note(self, committed: int, ended: bool, wrong: str) -> None:
        """Count a trial."""
        self.trials += 1
        self.committed += committed
        self.ended += ended
        self.wrong += [f"{self.trials}: {wrong}"] if wrong else []

    def line(self) -> str:
        """The row of a table in Markdown."""
        figures = (
            f"{self.trials} | {self.committed} | {self.ended} | {len(self.wrong)} | "
            f"{self.seconds:.1f}"
        )
        return f"| {self.name} | {self.database} | {figures} |"


@dataclass(frozen=True)
class Place:
    """Where libraries are made: SQLite in a folder, or PostgreSQL at a URL."""

    folder: Path
    url: str = ""

    @property
    def database(self) -> str:
        """The kind of database."""
        return "PostgreSQL" if self.url else "SQLite"

    def empty(self) -> str:
        """The name of a library with nothing in it."""
        if self.url:
            emptied(self.url)
            return self.url
        file = self.folder / "library.db"
        for each in self.folder.glob("library.db*"):
            each.unlink()
        return str(file)


def _written(
    target: str, number: int, rounds: int, tell: Callable[[str], None], size: int = 300
) -> None:
    write(target, number, rounds, f"w{number}", tell, size)


def forked(work: Callable[[Callable[[str], None]], None]) -> tuple[int, int]:
    """Run something in a process of its own, with a function to tell lines with; its number,
    and where they are read.
    """
    hear, tell = os.pipe()
    child = os.fork()
    if child:
        os.close(tell)
        return child, hear
    os.close(hear)
    code = 1
    try:
        work(partial(_told, tell))
        code = 0
    except BaseException as error:
        with suppress(OSError):
            _told(tell, f"error {type(error).__name__}: {str(error)[:200]!r}")
    finally:
        os._exit(code)


def _told(tell: int, said: str) -> None:
    os.write(tell, f"{said}\n".encode())


def heard(hear: int, count: int) -> str:
    """What a process tells, until it is so many lines or more."""
    said = b""
    while said.count(b"\n") < count and (more := os.read(hear, 4096)):
        said += more
    return said.decode()


def ended(child: int, hear: int, first: str = "") -> tuple[list[str], list[str]]:
    """Wait for a process; the marks of what was committed, and what else it told.

    `first` was heard before.
    """
    with os.fdopen(hear) as file:
        said = (first + file.read()).splitlines()
    os.waitpid(child, 0)
    return [each for each in said if not each.startswith("error")], [
        each for each in said if each.startswith("error")
    ]


def state(target: str, told: list[str]) -> str:
    """What is wrong with a library after a mishap."""
    from cellwright.kb.diagnostics import InvalidInput
    from cellwright.kb.store.store_maintenance import check_library

    try:
        findings = check_library(target)[0] if told else []
        lost = missing(target, told)
        write(target, 1, 3, "next", lambda _: None)
    except InvalidInput as error:
        return str(error)
    return "; ".join([each.message for each in findings] + ([f"lost {lost[:3]}"] if lost else []))


def kills(place: Place, table: Table, count: int, chance: random.Random) -> None:
    """SIGKILL at random moments."""
    for number in range(count):
        if number % 10 == 0:
            target = place.empty()
            before = list[str]()
        child, hear = forked(partial(_written, target, number, 10**6))
        first = heard(hear, chance.randrange(20))
        time.sleep(chance.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        told, errors = ended(child, hear, first)
        before += told
        table.note(len(told), True, "; ".join([*errors, state(target, before)]).strip("; "))


def full_disks(place: Place, table: Table, count: int, chance: random.Random) -> None:
    """No room any more behind a random number of bytes."""
    if place.url:
        for number in range(count):
            if number % 5 == 0:
                target = place.empty()
                write(target, 0, 2, "first", lambda _: None)
                before = list[str]()
            size = chance.randrange(5_000, 100_000)
            child, hear = forked(partial(_written, target, number, 60, size=size))
            _full(table, target, before, *ended(child, hear))
        return
    library = place.folder / "disk.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, SHIM, "-ldl"], check=True)
    for number in range(count):
        target = place.empty()
        write(target, 0, 3, "first", lambda _: None)
        room = chance.randrange(20_000, 400_000)
        code = "import sys; from stores_writer import alone; alone(*sys.argv[1:])"
        ran = subprocess.run(
            [sys.executable, "-c", code, target, str(number)],
            capture_output=True,
            text=True,
            check=False,
            env={
                **os.environ,
                "LD_PRELOAD": str(library),
                "DISK_FOLDER": str(place.folder / "library.db"),
                "DISK_ROOM": str(room),
                "PYTHONPATH": os.pathsep.join([str(SHIM.parents[3]), str(Path(__file__).parent)]),
            },
        )
        said = ran.stdout.splitlines()
        told = [each for each in said if not each.startswith("error")]
        _full(table, target, [], told, [each for each in said if each.startswith("error")])


def _full(table: Table, target: str, before: list[str], told: list[str], errors: list[str]) -> None:
    before += told
    strange = [
        each for each in errors if "InvalidInput" not in each and "JournalFailure" not in each
    ]
    table.note(len(told), bool(errors), "; ".join([*strange, state(target, before)]).strip("; "))


def spoiled(place: Place, table: Table, count: int, chance: random.Random) -> None:
    """Damage in the file or the rows of a library."""
    from cellwright.kb.diagnostics import InvalidInput

    target = place.empty()
    write(target, 0, 12, "sound", lambda _: None, 3000)
    sound = place.folder / "sound.db"
    if not place.url:
        shutil.copy(target, sound)
    for number in range(count):
        undo = damaged(target, sound, bool(place.url), random.Random(f"{chance.random()} {number}"))
        refused, wrong = 0, ""
        for name, read in read_everything(target):
            try:
                read()
            except InvalidInput as error:
                refused += 1
                wrong = wrong if error.diagnostics else f"{name}: no diagnostic"
            except Exception as error:
                wrong = f"{name}: {type(error).__name__}: {str(error)[:150]}"
        table.note(0, refused > 0, wrong)
        undo()


def writers(place: Place, table: Table, count: int, _chance: random.Random) -> None:
    """Processes that write at once."""
    from cellwright.kb.store.store_maintenance import check_library

    target, rounds = place.empty(), 25
    children = [forked(partial(_written, target, n, rounds)) for n in range(count)]
    for child, hear in children:
        told, errors = ended(child, hear)
        lost = missing(target, told)
        wrong = errors + ([f"lost {lost[:3]}"] if lost else [])
        table.note(len(told), bool(errors), "; ".join(wrong))
    findings = check_library(target)[0]
    table.wrong += [each.message for each in findings]
    if (found := len(content(target))) < table.committed:
        table.wrong.append(f"{found} of {table.committed} are there")


TABLES = {"kills": kills, "disk": full_disks, "damage": spoiled, "writers": writers}


def places(only: list[str], name: str, stack: ExitStack) -> Iterator[Place]:
    """The databases that are tried, for a table."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    if "sqlite" in only:
        yield Place(folder)
    if "postgres" in only and PROGRAMS:
        environment = {}
        if name == "disk":
            library = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "disk.so"
            library.parent.chmod(0o755)
            subprocess.run(
                ["cc", "-shared", "-fPIC", "-O1", "-o", library, SHIM, "-ldl"], check=True
            )
            environment = {
                "LD_PRELOAD": str(library),
                "DISK_FOLDER": "{data}/base/",
                "DISK_ROOM": "600000",
            }
        yield Place(folder, stack.enter_context(served(environment=environment)))


def main() -> int:
    """Print the tables, and what is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--table", nargs="+", choices=TABLES, default=list(TABLES))
    parser.add_argument(
        "--only", nargs="+", choices=("sqlite", "postgres"), default=["sqlite", "postgres"]
    )
    for name, count in (("kills", 200), ("full", 50), ("damage", 1000), ("writers", 8)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    counts = {
        "kills": asked.kills,
        "disk": asked.full,
        "damage": asked.damage,
        "writers": asked.writers,
    }
    found = list[Table]()
    print("| table | database | trials | committed | ended with diagnostics | wrong | s |")
    print("|---|---|--:|--:|--:|--:|--:|")
    for name in asked.table:
        with ExitStack() as stack:
            for place in places(asked.only, name, stack):
                table = Table(name, place.database)
                began = time.monotonic()
                TABLES[name](place, table, counts[name], random.Random(f"{asked.seed} {name}"))
                table.seconds = time.monotonic() - began
                found.append(table)
                print(table.line(), *(f"\n    {each}" for each in table.wrong[:20]), flush=True)
    if asked.json:
        asked.json.write_text(json.dumps([asdict(each) for each in found], indent=1), "utf-8")
    return int(any(each.wrong for each in found))


if __name__ == "__main__":
    sys.exit(main())
