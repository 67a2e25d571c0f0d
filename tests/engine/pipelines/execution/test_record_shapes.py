"""What a run writes passes the door, and nothing else does; behind it no reader meets damage."""

import json
import random
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    results_of,
    resume_run,
)
from cellwright.engine.pipelines.execution.record_shapes import (
    SHAPE_OF_RECORD,
    DamagedRecord,
    read_record,
)
from cellwright.engine.pipelines.execution.run_journal import reading_past, trusting_past
from cellwright.engine.pipelines.planning.plan_gate import InternalError
from cellwright.engine.pipelines.simulators import Injection
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.store.journal import JournalLine
from tests.engine.pipelines.execution.executed_cells import BEGIN, executed, planned

STRANGE = (None, True, -1, 10**30, 0.5, "", "p(", "X", "nobody", [], [[]], {}, {"a": 1}, [-1])


@pytest.mark.parametrize(
    ("target", "faults"),
    [("themse/one", ()), ("themse/one", (Injection("pick", "not_gripped", 1),)), ("bulkhead/both_tools", ())],
)  # fmt: skip
def test_what_a_run_writes_passes_the_door(target: str, faults: tuple[Injection, ...]) -> None:
    _, records, _ = executed(target, faults)
    assert {record.kind for record in records} >= {  # `Kept` has read each of them
        RecordKind.PLAN,
        RecordKind.COMMAND,
        RecordKind.DONE,
    }


def test_every_kind_has_a_shape() -> None:
    assert set(SHAPE_OF_RECORD) == set(RecordKind)


def test_our_own_mistakes_are_not_taken_for_damage() -> None:
    for mistake in (AttributeError, TypeError, AssertionError, KeyError, ValueError):
        with pytest.raises(mistake), reading_past("j.db", "r"):
            raise mistake
    with pytest.raises(InvalidInput, match="K422"), reading_past("j.db", "r"):
        raise DamagedRecord


def test_what_follows_from_records_without_digests_is_no_mistake_of_ours() -> None:
    refused = InternalError([Diagnostic(Source("plan"), "K501", "step 1 cannot be taken")])
    with pytest.raises(InternalError), trusting_past("j.db", "r", is_proved=True):
        raise refused
    with (
        pytest.raises(InvalidInput, match=r"K422.*does not fit together"),
        trusting_past("j.db", "r", is_proved=False),
    ):
        raise refused


@pytest.mark.parametrize(
    ("kind", "content", "said"),
    [
        ("nosuch", {}, "line 7 is of an unknown kind: 'nosuch'"),
        ("reply", {"command": 1, "data": {}}, "line 7 (reply): `text` is missing"),
        ("reply", {"command": True, "text": "", "data": {}}, "line 7 (reply): `command` is not"),
        ("goal", {"goal": ["a"]}, "line 7 (goal): `goal` is not as a run writes it"),
    ],
)
def test_the_place_of_a_damage_is_told(kind: str, content: dict[str, Any], said: str) -> None:
    with pytest.raises(DamagedRecord) as told:
        read_record(JournalLine(7, 0, kind, content))
    assert str(told.value).startswith(said)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of a run with an exception, that was stopped on its way, as one that an older
    version wrote: without digests.
    """
    store = tmp_path_factory.mktemp("stopped") / "j.db"
    problem, _ = planned("themse/one")
    wanted = RunRequest(
        "themse/one", store=str(store), run="r", options={"fault": "pick=not_gripped"}
    )
    orders = TimedOrders([(60_000, GivenOrder(OperatorCommand.STOP))])
    begin_run(name_run(wanted, problem), problem, orders)
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("DELETE FROM journal_heads")
        connection.execute("UPDATE journal SET link = NULL")
    return store


def places(value: object, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path to each part of a JSON value."""
    parts = value.items() if isinstance(value, dict) else ()
    parts = enumerate(value) if isinstance(value, list) else parts
    for key, part in parts:
        yield (*path, key)
        yield from places(part, (*path, key))


def changed(content: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """The content of a record with one part that is missing, or has another value."""
    *way, last = chance.choice(list(places(content)) or [("new",)])
    place: Any = content
    for key in way:
        place = place[key]
    if chance.random() < 0.2 and isinstance(place, dict):
        place.pop(last, None)
    else:
        place[last] = chance.choice(STRANGE)
    return content


def damage(store: Path, chance: random.Random) -> None:
    """Change one part of one line."""
    with closing(sqlite3.connect(store)) as connection, connection:
        kinds = connection.execute("SELECT DISTINCT kind FROM journal").fetchall()
        (kind,) = chance.choice(sorted(kinds))
        rows = connection.execute("SELECT number, content FROM journal WHERE kind = ?", (kind,))
        number, text = chance.choice(rows.fetchall())
        new = json.dumps(changed(json.loads(text), chance))
        connection.execute("UPDATE journal SET content = ? WHERE number = ?", (new, number))


def outcome_of(read: Callable[[], object]) -> str:
    """How reading a journal ends: refused by a code, or not."""
    try:
        read()
    except InvalidInput as error:
        return error.diagnostics[0].code
    return "read"


@given(seed=st.integers(0, 2**32))
@settings(max_examples=25)
def test_whatever_a_journal_without_digests_holds_it_is_read_or_refused(
    seed: int, stopped: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    store = shutil.copy(stopped, tmp_path_factory.mktemp("damaged") / "j.db")
    shutil.copy(f"{stopped}.r.sim.jsonl", f"{store}.r.sim.jsonl")
    damage(Path(store), random.Random(seed))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BEGIN, "make_driver", _never)
        said = outcome_of(lambda: resume_run(str(store), "r", TimedOrders(), unchained=True))
    assert said in ("K422", "made"), said
    assert outcome_of(lambda: results_of(str(store), "r")) in ("K422", "read")


def test_a_fact_that_no_predicate_declares_is_damage(stopped: Path, tmp_path: Path) -> None:
    store = shutil.copy(stopped, tmp_path / "j.db")
    with closing(sqlite3.connect(store)) as connection, connection:
        row = "SELECT number, content FROM journal WHERE kind = 'done' ORDER BY number DESC"
        number, text = connection.execute(row).fetchone()
        content = json.loads(text)
        content["adds"].append("nobody")
        new = json.dumps(content)
        connection.execute("UPDATE journal SET content = ? WHERE number = ?", (new, number))
    with pytest.raises(InvalidInput, match="nobody is told of, and is no fact of the domain"):
        resume_run(str(store), "r", TimedOrders(), unchained=True)


def _never(*_: object) -> None:
    raise InvalidInput([Diagnostic(Source("here"), "made", "all was read")])
