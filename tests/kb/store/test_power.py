"""Power is lost at any moment, and disks are full: what was promised to be kept is there, and
answers are given.
"""

import json
import os
import random
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import Library
from cellwright.kb.store.database import OutOfReach
from cellwright.kb.store.journal import Journal
from cellwright.kb.store.store_maintenance import check_library

COMPILER = shutil.which("cc") or shutil.which("gcc")
pytestmark = pytest.mark.skipif(
    COMPILER is None or sys.platform != "linux", reason="needs a C compiler and Linux"
)

WRITER = """
import sys
from pathlib import Path
from cellwright.kb.store.case_store import Cases, ClosedCase
from cellwright.kb.store.journal import Journal, JournalLine
folder = Path(sys.argv[1])
acks = open(folder / "acks", "ab", buffering=0)
with Journal(str(folder / "j.db")) as journal, Cases(str(folder / "j.db")) as cases:
    journal.begin("r", "", {})
    for number in range(1, 13):
        journal.append("r", [JournalLine(number, number, "done", {"text": "x" * 300 * number})])
        cases.add([ClosedCase("cell", "lost", ("slipped",))])
        acks.write(b"%d" % number + chr(10).encode())
"""


@pytest.fixture(scope="session")
def disk(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The library that is preloaded."""
    made = tmp_path_factory.mktemp("disk") / "disk.so"
    source = Path(__file__).with_name("disk.c")
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-O1", "-o", made, source, "-ldl"], check=True
    )
    return str(made)


Note = tuple[str, str, int, bytes]  # kind, file, offset, data


def notes(log: bytes) -> Iterator[Note]:
    at = 0
    while at < len(log):
        kind, length, offset, count = chr(log[at]), *struct.unpack_from("<QQQ", log, at + 1)
        at += 25
        path = log[at : at + length].decode()
        at += length
        size = count if kind == "w" else 0
        yield kind, Path(path).name, offset, log[at : at + size]
        at += size


def after_power_loss(happened: list[Note], chance: random.Random) -> dict[str, bytes]:
    """Files as they may be: synced writes are there, of the others any."""
    synced = {name: at for at, (kind, name, _, _) in enumerate(happened) if kind == "s"}
    files: dict[str, bytearray] = {}
    for at, (kind, name, offset, data) in enumerate(happened):
        if at > synced.get("watched" if kind == "u" else name, -1) and chance.random() < 0.5:
            continue
        if kind == "u":
            files.pop(name, None)
            continue
        file = files.setdefault(name, bytearray())
        if kind == "w":
            file.extend(bytes(max(0, offset + len(data) - len(file))))
            file[offset : offset + len(data)] = data
        elif kind == "t":
            del file[offset:]
            file.extend(bytes(offset - len(file)))
    return {name: bytes(file) for name, file in files.items()}


@pytest.mark.slow
def test_what_was_acknowledged_survives_a_loss_of_power_at_any_moment(
    disk: str, tmp_path: Path
) -> None:
    folder, log = tmp_path / "watched", tmp_path / "log"
    folder.mkdir()
    settings = {**os.environ, "LD_PRELOAD": disk, "DISK_FOLDER": str(folder), "DISK_LOG": str(log)}
    subprocess.run([sys.executable, "-c", WRITER, str(folder)], check=True, env=settings)
    happened = list(notes(log.read_bytes()))
    chance, again = random.Random(3), tmp_path / "again"
    acks = [at for at, (_, name, _, _) in enumerate(happened) if name == "acks"]
    assert len(acks) == 12
    for moment in [
        *(at + 1 for at in acks),
        *(chance.randrange(acks[0], len(happened)) for _ in range(12)),
    ]:
        shutil.rmtree(again, ignore_errors=True)
        again.mkdir()
        for name, data in after_power_loss(happened[:moment], chance).items():
            if name.startswith("j.db") and not name.endswith("-shm"):
                (again / name).write_bytes(data)
        acknowledged = sum(at < moment for at in acks)
        with Journal(str(again / "j.db")) as journal:
            assert journal.last("r") >= acknowledged
        findings, rows = check_library(str(again / "j.db"))
        assert findings == []
        assert rows["fault_cases"] >= acknowledged


@pytest.mark.parametrize(
    "room", [0, *(pytest.param(each, marks=pytest.mark.slow) for each in (40_000, 90_000))]
)
def test_a_full_disk_does_not_take_the_answer_with_it(disk: str, tmp_path: Path, room: int) -> None:
    folder = tmp_path / "watched"
    folder.mkdir()
    words = [
        "-m",
        "cellwright.engine.faces.cli",
        "plan",
        "bulkhead/one_point",
        "--store",
        str(folder / "s.db"),
        "--format",
        "json",
    ]
    subprocess.run(
        [sys.executable, *words[:2], "macros", "list", *words[-4:-2]],
        check=True,
        capture_output=True,
    )
    settings = {
        **os.environ,
        "LD_PRELOAD": disk,
        "DISK_FOLDER": str(folder),
        "DISK_ROOM": str(room),
    }
    told = subprocess.run([sys.executable, *words], capture_output=True, env=settings, check=False)
    answer = json.loads(told.stdout)
    assert (told.returncode, bool(answer["data"]["plan"]["steps"])) == (0, True)
    lost = [each["code"] for each in answer["diagnostics"]]
    assert lost == (["K416"] if room < 60_000 else lost)
    assert check_library(str(folder / "s.db"))[0] == []


def test_an_answer_is_given_beside_a_library_that_cannot_be_opened(tmp_path: Path) -> None:
    with Library(str(tmp_path), beside=True) as library:
        assert "unable to open" in library.loss
        assert (library.writable, library.outlines("themse")) == (False, [])
    with pytest.raises(OutOfReach, match="unable to open"):
        Library(str(tmp_path))


def test_a_mistake_in_the_name_of_a_library_is_told_before_an_answer_is_sought(
    tmp_path: Path,
) -> None:
    (tmp_path / "notes").write_text("no database, " * 100)
    for name in ("notes", "missing/library.db"):
        with pytest.raises(InvalidInput):
            Library(str(tmp_path / name), beside=True)


def test_an_answer_is_given_beside_a_server_that_does_not_answer() -> None:
    pytest.importorskip("psycopg")
    with Library("postgresql://me@localhost:1/macrops", beside=True) as library:
        assert "refused" in library.loss
