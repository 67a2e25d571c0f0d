#!/usr/bin/env bash
# Field: line protocols of controllers (asyncio streams). Date: 2026-11-29. Version: Python 3.11.
# Expected guess: after the error about a line that is longer than the limit, the next line that is
# read is the line behind it.
# Seen: what was in the buffer is thrown away, and the rest of the same line comes as a line of its
# own. What a peer wrote inside a text is then read as a message.
# Cellwright was hit: a controller is read in pieces now, and a line that is too long is dropped to
# its end (`LineSplitter`).
set -euo pipefail
python3 - <<'PYTHON'
import asyncio
import platform
import sys


async def lines_read() -> list[str]:
    reader = asyncio.StreamReader(limit=16)
    seen = []
    reader.feed_data(b'{"text": "a long text in several pieces, ')
    try:
        await reader.readline()
    except ValueError:
        seen.append("too long")
    reader.feed_data(b'"halt"}\n')
    reader.feed_data(b"next\n")
    reader.feed_eof()
    while text := await reader.readline():
        seen.append(text.decode().strip())
    return seen


seen = asyncio.run(lines_read())
print("Python", platform.python_version())
print("expected:", ["too long", "next"])
print("seen:    ", seen)
sys.exit(0 if seen == ["too long", '"halt"}', "next"] else 1)
PYTHON
