#!/usr/bin/env bash
# Field: automated planning, unified-planning (Python). Date: 2026-11-28. Version: unified-planning 1.3.0.
# Guess: `one <= other` on two problem kinds is a question, and leaves both as they are.
# Seen: it brings both to the newest version of kinds, in place. Features that this version no longer has
# (NUMERIC_FLUENTS, DISCRETE_NUMBERS, CONTINUOUS_NUMBERS) are gone from the kind afterwards, and the answer is True.
# So an engine whose `supports` is `kind <= SUPPORTED` says yes to a kind with NUMERIC_FLUENTS, and who asks again later
# sees no numbers in it. Ours was hit; `supports` now looks at the features before it compares, and every feature is tried.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check 'unified-planning==1.3.0' 2>/dev/null
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from importlib.metadata import version

from unified_planning.model import ProblemKind

print("unified-planning", version("unified-planning"))
asked = ProblemKind({"ACTION_BASED", "NUMERIC_FLUENTS"}, version=3)
known = ProblemKind({"ACTION_BASED"}, version=3)
before = set(asked.features)
answer = asked <= known
print("features before:", sorted(before))
print("expected: <= is False, features stay")
print(f"seen: <= is {answer}, features after: {sorted(asked.features)}")
sys.exit(0 if answer and set(asked.features) == {"ACTION_BASED"} else 1)
PYTHON
