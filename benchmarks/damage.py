"""Damages journals of runs in every way, and looks at what each command makes of them.

    python benchmarks/damage.py [--damages N] [--seed N] [--json FILE]

Three journals are made: of a run that was stopped, of one that was killed while it handled an
exception, and of one with checkpoints. Each damage changes one thing in one of them: a field of a
record of each kind, the order, a gap, a cut, a head, what the run was begun with, a number, a kind.
Half of the journals are as this version writes them: `resume`, `results`, `store check` and `store
verify` have to refuse or tell it, and no driver may be made. The others have no digests, as older
versions wrote them, and are resumed with `--unchained`: they may be taken up or refused. No command
may end with an internal error (exit code 70). With --json what has passed is kept, and is not tried
again by the next call. Exits with 1 if anything ends otherwise.
"""

import argparse
import json
import random
import shutil
import sqlite3
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    run_control,
    run_start,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of

TARGET, RUN = "themse/one", "r"
INTERNAL_ERROR = 70
STRANGE: tuple[object, ...] = (
    None, True, -1, 10**30, 0.5, "", "p(", "X", "nobody", [], [[]], {}, {"a": 1}, [-1],
)  # fmt: skip
STRANGE_CELLS: tuple[object, ...] = (None, "", "x", -1, 10**12, 0.5, b"\xff\xfe", "\U0001f600")
Damage = Callable[[sqlite3.Connection, random.Random], None]


class Killed(BaseException):
    """The process is gone."""


def make_journals(folder: Path) -> list[Path]:
    """The journals that are damaged."""
    stop = TimedOrders([(60_000, GivenOrder(OperatorCommand.STOP))])
    made = [_make_journal(folder / "stopped", stop)]
    made.append(_make_journal(folder / "killed", TimedOrders(), kill_at=RecordKind.FINDING))
    many, run_control.RECORDS_PER_CHECKPOINT = run_control.RECORDS_PER_CHECKPOINT, 15
    late = TimedOrders([(700_000, GivenOrder(OperatorCommand.STOP))])
    made.append(_make_journal(folder / "checkpoints", late))
    run_control.RECORDS_PER_CHECKPOINT = many
    return made


def _make_journal(folder: Path, orders: TimedOrders, kill_at: RecordKind | None = None) -> Path:
    folder.mkdir()
    problem, store = problem_of(TARGET), folder / "j.db"
    request = RunRequest(TARGET, store=str(store), run=RUN, options={"fault": "pick=not_gripped"})

    def watch(record: JournalRecord) -> None:
        if record.kind is kill_at:
            raise Killed

    with suppress(Killed):
        begin_run(name_run(request, problem), problem, orders, [watch])
    return store


def places(value: object, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path to each part of a JSON value."""
    parts: Any = value.items() if isinstance(value, dict) else ()
    parts = enumerate(value) if isinstance(value, list) else parts
    for key, part in parts:
        yield (*path, key)
        yield from places(part, (*path, key))


def change_content(content: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """The content of a record with one part that is missing, or has another value."""
    *way, last = chance.choice(list(places(content)) or [("new",)])
    place: Any = content
    for key in way:
        place = place[key]
    if chance.random() < 0.2 and isinstance(place, dict):
        place.pop(last, None)
    else:
        others = [
            value for value in STRANGE if not isinstance(place, dict) or place.get(last) != value
        ]
        place[last] = chance.choice(others)
    return content


def _some_line(connection: sqlite3.Connection, chance: random.Random) -> tuple[int, str]:
    """A line, each kind of which is as likely as the others."""
    kinds = sorted(connection.execute("SELECT DISTINCT kind FROM journal").fetchall())
    asked = "SELECT number, content FROM journal WHERE kind = ?"
    number, content = chance.choice(connection.execute(asked, chance.choice(kinds)).fetchall())
    return int(number), str(content)


def damage_field(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Change one part of what a line says."""
    number, content = _some_line(connection, chance)
    new = json.dumps(change_content(json.loads(content), chance))
    connection.execute("UPDATE journal SET content = ? WHERE number = ?", (new, number))


def damage_text(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Change a character of what a line says."""
    number, content = _some_line(connection, chance)
    place = chance.randrange(len(content))
    new = content[:place] + chance.choice('{}[]",:x0 ') + content[place + 1 :]
    new = new if new != content else content[:place]
    connection.execute("UPDATE journal SET content = ? WHERE number = ?", (new, number))


def damage_cell(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Put something else into a column of a line."""
    number, _ = _some_line(connection, chance)
    column = chance.choice(["at_ms", "kind", "content", "number", "link"])
    value = chance.choice(STRANGE_CELLS)
    value = "" if value is None and column != "link" else value
    connection.execute(f"UPDATE journal SET {column} = ? WHERE number = ?", (value, number))


def damage_order(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Exchange two lines."""
    numbers = [n for (n,) in connection.execute("SELECT number FROM journal ORDER BY number")]
    one, other = chance.sample(numbers, 2)
    for old, new in ((one, -1), (other, one), (-1, other)):
        connection.execute("UPDATE journal SET number = ? WHERE number = ?", (new, old))


def damage_gap(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Take a line out."""
    number, _ = _some_line(connection, chance)
    connection.execute("DELETE FROM journal WHERE number = ?", (number,))


def damage_end(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Cut the end off."""
    (last,) = connection.execute("SELECT max(number) FROM journal").fetchone()
    connection.execute("DELETE FROM journal WHERE number > ?", (chance.randrange(last),))


def damage_head(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Change the head."""
    column = chance.choice(["number", "link"])
    value = chance.choice([value for value in STRANGE_CELLS if value is not None])
    connection.execute(f"UPDATE journal_heads SET {column} = ?", (value,))


def damage_beginning(connection: sqlite3.Connection, chance: random.Random) -> None:
    """Change what the run was begun with."""
    (document,) = connection.execute("SELECT document FROM runs").fetchone()
    new = json.dumps(change_content(json.loads(document), chance))
    connection.execute("UPDATE runs SET document = ?", (new,))


DAMAGES: tuple[Damage, ...] = (
    damage_field, damage_field, damage_field, damage_field, damage_text, damage_cell, damage_cell,
    damage_order, damage_gap, damage_end, damage_head, damage_beginning,
)  # fmt: skip


def remove_digests(connection: sqlite3.Connection) -> None:
    """Make a journal as an older version has written it."""
    connection.execute("DELETE FROM journal_heads")
    connection.execute("UPDATE journal SET link = NULL")


def copy_journal(source: Path, folder: Path) -> Path:
    """A copy of a journal with the log of its cell."""
    for file in source.parent.iterdir():
        shutil.copy(file, folder / file.name)
    return folder / source.name


def damaged_copy(sources: Sequence[Path], number: int, seed: int, folder: Path) -> tuple[Path, str]:
    """A journal with the damage of this number, and what it is."""
    chance = random.Random(f"{seed} {number}")
    source, damage = chance.choice(sources), DAMAGES[number // 2 % len(DAMAGES)]
    store = copy_journal(source, folder)
    with closing(sqlite3.connect(store)) as connection, connection:
        if number % 2:
            remove_digests(connection)
        damage(connection, chance)
    return store, f"{damage.__name__} of {source.parent.name}"


def try_damage(store: Path, chained: bool) -> str:
    """What is wrong with how commands take a damaged journal; empty if nothing."""
    drivers: list[object] = []
    make_driver = run_start.make_driver

    def watched(*setup: Any) -> Any:
        drivers.append(setup)
        return make_driver(*setup)

    run_start.make_driver = watched
    codes = dict[str, int]()
    try:
        for words in (["results", RUN], ["store", "check"], ["store", "verify"], ["resume", RUN]):
            more = [] if chained or words[0] != "resume" else ["--unchained"]
            answer = CliRunner().invoke(app, [*words, "--store", str(store), *more])
            codes[" ".join(words)] = answer.exit_code
            if answer.exit_code == INTERNAL_ERROR or _is_bug(answer.exception):
                return f"{' '.join(words)}: {answer.exception!r} {answer.output[-400:]}"
    finally:
        run_start.make_driver = make_driver
    if not chained:
        return ""
    if drivers:
        return "a driver was made"
    passed = [words for words, code in codes.items() if code == 0]
    return f"not told by {', '.join(passed)}" if passed else ""


def _is_bug(error: BaseException | None) -> bool:
    return error is not None and not isinstance(error, SystemExit)


def main() -> int:
    """Damage journals, and print what went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--damages", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    kept = asked.json is not None and asked.json.is_file()
    passed = set[int](json.loads(asked.json.read_text("utf-8")) if kept else ())
    wrong, counts = 0, Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        sources = make_journals(Path(name))
        for number in range(asked.damages):
            if number in passed:
                continue
            with tempfile.TemporaryDirectory() as place:
                store, what = damaged_copy(sources, number, asked.seed, Path(place))
                said = try_damage(store, chained=number % 2 == 0)
            counts[what.partition(" ")[0]] += 1
            if said:
                wrong += 1
                print(f"{number}: {what}: {said}", flush=True)
                continue
            passed.add(number)
            if asked.json is not None and (len(passed) % 20 == 0 or number == asked.damages - 1):
                asked.json.write_text(json.dumps(sorted(passed)), "utf-8")
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    print(f"{asked.damages} damages (now {kinds}), {len(passed)} right, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
