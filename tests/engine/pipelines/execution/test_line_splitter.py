"""Lines come out whole wherever a stream is cut; one that is too long is dropped to its end."""

from hypothesis import given
from hypothesis.strategies import binary, lists

from cellwright.engine.pipelines.execution.controllers.line_splitter import LineSplitter

MOST = 5


@given(lists(binary(max_size=12).map(lambda piece: piece.replace(b"\x00", b"\n")), max_size=12))
def test_lines_are_those_of_the_whole_stream(chunks: list[bytes]) -> None:
    splitter = LineSplitter(MOST)
    lines = [line for chunk in chunks for line in splitter.feed(chunk)]
    *ended, rest = b"".join(chunks).split(b"\n")
    wanted: list[bytes | None] = [line if len(line) <= MOST else None for line in ended]
    assert lines == wanted + ([None] if len(rest) > MOST else [])
    assert splitter.dropped == (len(rest) if len(rest) > MOST else 0)
