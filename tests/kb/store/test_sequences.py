"""A sequence plan is read as it was written, and nobody overwrites what he has not read."""

import json
from dataclasses import replace

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import Library
from cellwright.kb.store.case_store import Cases, ClosedCase
from cellwright.kb.store.database import connect_engine, open_transaction
from cellwright.kb.store.inspection_store import PlannedVisit, SequencePlan, Sequences
from cellwright.kb.store.table_schema import sequences as table

PLAN = SequencePlan(
    "bulkhead",
    "plate",
    done=(PlannedVisit("a", "slra", (0.1, 0.2, 0.30000000000000004)),),
    rest=(
        PlannedVisit("b", "us_probe", (1e-6, 0.0, -0.5)),
        PlannedVisit("c", "us_probe", (1.0, 2.0, 3.0)),
    ),
    lost=("slra",),
    bad={"d": "rust, 'dirt' and \"grime\""},
    impossible={"e": "zu breit für die Bohrung"},
    changes=(("slra", "us_probe", 2_000_000),),
)


def test_a_plan_is_read_as_it_was_written(target: str) -> None:
    with Sequences(target) as sequences:
        assert sequences.of("bulkhead", "plate") is None
        assert sequences.keep(PLAN)
    with Sequences(target) as sequences:
        assert sequences.of("bulkhead", "plate") == replace(PLAN, version=1)
        assert sequences.of("themse", "plate") is None


def test_who_has_not_read_the_last_version_writes_nothing(target: str) -> None:
    with Sequences(target) as one, Sequences(target) as other:
        assert one.keep(PLAN)
        assert not other.keep(replace(PLAN, done=()))
        mine, theirs = one.of("bulkhead", "plate"), other.of("bulkhead", "plate")
        assert mine is not None
        assert theirs is not None
        assert other.keep(replace(theirs, lost=()))
        assert not one.keep(replace(mine, rest=()))
        assert one.of("bulkhead", "plate") == replace(PLAN, lost=(), version=2)


def test_plans_live_beside_cases_and_macrops(target: str) -> None:
    with Cases(target) as cases:
        cases.add([ClosedCase("bulkhead", "no_echo", ("broken_probe",))])
    with Sequences(target) as sequences:
        assert sequences.keep(PLAN)
    with Library(target) as library, Cases(target) as cases:
        assert library.figures().macrops == 0
        assert len(cases.history("bulkhead")) == 1
    with Sequences(target) as sequences:
        assert sequences.of("bulkhead", "plate") is not None


@pytest.mark.parametrize("document", ["", "{}", "[]", json.dumps({"done": 1})])
def test_a_plan_that_cannot_be_read_is_told(target: str, document: str) -> None:
    with Sequences(target) as sequences:
        assert sequences.keep(PLAN)
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        connection.execute(table.update().values(document=document))
    engine.dispose()
    with Sequences(target) as sequences, pytest.raises(InvalidInput, match="plate cannot be read"):
        sequences.of("bulkhead", "plate")
