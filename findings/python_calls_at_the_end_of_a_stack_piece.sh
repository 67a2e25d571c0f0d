#!/usr/bin/env bash
# Field: Python itself. Date: 2026-11-29. Versions: CPython 3.11.7, 3.12.1 and 3.13.0 (no packages).
# Expected guess: a call costs the same however deep it stands in the stack of calls.
# Seen: at about one depth in a hundred it costs hundreds of times as much. Frames stand in pieces
# of 16 KiB; a call that does not fit into the last piece asks the system for another one, and gives
# it back when it returns. A loop at this depth does so in each round (one page fault per call).
# Cellwright was hit: an import within imports adds six frames each, and `import pydantic` stood so
# deep in `cellwright plan` that it took 40 ms more, a tenth of the whole command. Doorways of rooms
# now load large libraries first, where fewer calls are open (`open_doorway(..., libraries=...)`).
set -euo pipefail
python3 - <<'PYTHON'
import resource
import sys
import time

ROUNDS = 1000


def call_with_a_large_frame():
    if 0:
        a = b = c = d = e = f = g = h = i = j = k = l = m = n = o = p = q = r = s = t = u = v = 0


def cost_at(depth):
    if depth:
        return cost_at(depth - 1)
    faults, started = resource.getrusage(resource.RUSAGE_SELF).ru_minflt, time.perf_counter()
    for _ in range(ROUNDS):
        call_with_a_large_frame()
    seconds = time.perf_counter() - started
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - faults, seconds


costs = [cost_at(depth) for depth in range(300)]
usual = sorted(seconds for _, seconds in costs)[150]
dear = {depth: round(seconds / usual) for depth, (faults, seconds) in enumerate(costs)
        if faults >= ROUNDS}
quiet = sum(faults < ROUNDS / 100 for faults, _ in costs)
print("Python", sys.version.split()[0])
print("expected: no depth at which", ROUNDS, "calls cost a page fault each")
print("seen: depth and how many times as long as usual:", dear)
print("depths without such faults:", quiet, "of", len(costs))
sys.exit(0 if dear and quiet >= 290 else 1)
PYTHON
