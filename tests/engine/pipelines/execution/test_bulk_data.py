"""Pieces of bulk data are joined by name; those of a command that sends too many are dropped."""

import pytest
from hypothesis import given
from hypothesis.strategies import integers, lists, sampled_from, text, tuples

from cellwright.engine.pipelines.execution.controllers import bulk_data
from cellwright.engine.pipelines.execution.controllers.bulk_data import BulkData
from cellwright.engine.pipelines.execution.controllers.protocol import MalformedLine


@given(lists(tuples(integers(1, 3), sampled_from("ab"), text(max_size=4)), max_size=20))
def test_pieces_of_a_name_are_joined_in_their_order(pieces: list[tuple[int, str, str]]) -> None:
    bulk = BulkData()
    for number, name, piece in pieces:
        bulk.add(number, name, piece)
    for number in (1, 2, 3):
        names = {name for which, name, _ in pieces if which == number}
        wanted = {
            name: "".join(p for which, n, p in pieces if (which, n) == (number, name))
            for name in names
        }
        assert bulk.joined(number) == wanted
        assert bulk.joined(number) == {}
    assert bulk == BulkData()


@pytest.mark.parametrize("piece", ["y" * 100, "\U0001f600" * 10])
def test_too_many_pieces_are_dropped_and_the_next_command_has_room_again(
    piece: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bulk_data, "MAX_BULK_BYTES", 2_000)
    bulk = BulkData()

    def fill(number: int) -> None:
        for _ in range(100):
            bulk.add(number, "n", piece)

    with pytest.raises(MalformedLine, match="command 1"):
        fill(1)
    bulk.add(1, "n", piece)
    assert bulk.joined(1) == {}
    bulk.add(2, "n", piece)
    assert bulk.joined(2) == {"n": piece}
