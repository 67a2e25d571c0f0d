"""Lines out of the bytes of a stream; a line that is too long is dropped to its end."""

from collections.abc import Iterator


class LineSplitter:
    """Cuts what comes into lines of at most `most` bytes, without their ends."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._begun = bytearray()
        self._drops = False
        self.dropped = 0  # bytes of the line that is being dropped

    def feed(self, chunk: bytes) -> Iterator[bytes | None]:
        """The lines that end in a piece; None for each line that is found to be too long."""
        *ends, rest = chunk.split(b"\n")
        for end in ends:
            if self._drops:
                self._drops, self.dropped = False, 0
            elif len(self._begun) + len(end) > self._most:
                self._begun.clear()
                yield None
            else:
                self._begun += end
                line = bytes(self._begun)
                self._begun.clear()
                yield line
        if self._drops:
            self.dropped += len(rest)
        elif len(self._begun) + len(rest) > self._most:
            self._drops, self.dropped = True, len(self._begun) + len(rest)
            self._begun.clear()
            yield None
        else:
            self._begun += rest
