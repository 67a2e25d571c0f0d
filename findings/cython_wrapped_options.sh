#!/usr/bin/env bash
# Field: compiling Python (Cython). Date: 2026-11-29. Versions: Cython 3.3.1, Python 3.11.
# Expected guess: a `# cython:` comment whose list of options ends with a comma goes on in the
# comment on the next line, or the compiler says that something is missing.
# Seen: the options on the next line are ignored without a message, also where that line holds a
# second `cython:` further on. Here `wraparound=False` is lost, so the loop checks for negative
# indices again.
# Cellwright was hit: wrapping comments at 100 columns switched options of 59 kernels off. It is
# guarded: a test reads the options of each kernel, one `# cython:` a line.
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet cython==3.3.1
cd "$place"
body='
def total(int[::1] row):
    cdef int index, sum = 0
    for index in range(row.shape[0]):
        sum += row[index]
    return sum // row[0]
'
printf '# cython: language_level=3, boundscheck=False\n# cython: wraparound=False, cdivision=True\n%s' \
    "$body" > apart.pyx
printf '# cython: language_level=3, boundscheck=False,\n# wraparound=False cython: cdivision=True\n%s' \
    "$body" > wrapped.pyx
venv/bin/cython --version
venv/bin/cython -Wextra apart.pyx wrapped.pyx > messages.txt 2>&1
echo "messages: $(cat messages.txt)"
checks() { grep -c "$1" "$2.c" || true; }
zero="division or modulo by zero"
negative="__pyx_t_[0-9]* += __pyx_v_row.shape"
for what in "$zero" "$negative"; do
    echo "checks '$what': apart $(checks "$what" apart), wrapped $(checks "$what" wrapped)"
    test "$(checks "$what" wrapped)" -gt "$(checks "$what" apart)"
done
echo "expected: as many in both, or a message"
test ! -s messages.txt
