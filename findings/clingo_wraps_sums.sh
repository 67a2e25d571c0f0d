#!/usr/bin/env bash
# Field: answer set programming (clingo). Date: 2026-11-28. Versions: clingo 5.8.0, Python 3.11.
# Expected guess: an overflow is an error, or at least a message, as division by zero is
# ("operation undefined").
# Seen: sums, products and #sum wrap around at 32 bits without a message, so `L + L > 0` is false
# for 2,000,000,000.
# Cellwright could be hit wherever clingo evaluates rules of a domain. It is guarded: rules derive
# the values of each operation that may be too large, and the result is computed again exactly
# (diagnostic K113).
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet clingo==5.8.0
"$place/venv/bin/python" - <<'PYTHON'
import sys
import clingo

messages = []
control = clingo.Control(logger=lambda code, text: messages.append((str(code), text)))
control.add("base", [], """
limit(2000000000). w(a,2000000000). w(b,2000000000).
double(L + L) :- limit(L).     positive :- limit(L), L + L > 0.
total(S) :- S = #sum { N,X : w(X,N) }.
square(L * L) :- limit(L).
undefined(1 / 0).
""")
control.ground([("base", [])])
atoms = {str(atom.symbol) for atom in control.symbolic_atoms if atom.is_fact}
print("clingo", clingo.__version__)
print("expected: an error or a message about 4000000000, which does not fit")
told = ("double", "positive", "total", "square")
print("seen:", ", ".join(sorted(atom for atom in atoms if atom.startswith(told))))
print("messages:", messages)
wrapped = "double(-294967296)" in atoms and "total(-294967296)" in atoms and "positive" not in atoms
silent = len(messages) == 1 and "undefined" in messages[0][1]
sys.exit(0 if wrapped and silent else 1)
PYTHON
