"""A mutation run in one process finds for each mutant what a run of all tests would find."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.places import TOP

JUDGE = """LIMIT = 3

def allowed(number):
    while number > 10:
        number -= 10
    if number == 7:
        return "seven"
    return number < LIMIT

def asked():
    return "asked"

def never(number):
    return number + 1
"""
TESTS = """import subprocess
import sys
from judge import allowed

def test_small_numbers_are_allowed():
    assert allowed(2)
    assert allowed(11)

def test_large_ones_are_not():
    assert not allowed(3)

def test_from_outside():
    subprocess.run([sys.executable, "-c", "import judge; assert judge.asked() == 'asked'"], check=True)
"""
MUTANTS = [  # line, old, new, what becomes of it
    (1, "LIMIT = 3", "LIMIT = 4", "killed"),
    (1, "LIMIT = 3", "LIMIT = 2.5", "survived"),
    (1, "LIMIT = 3", "LIMIT = ", "killed"),
    (5, "number -= 10", "number -= 0", "timeout"),
    (6, "number == 7", "number == 2", "survived"),  # "seven" is as good as True
    (7, '"seven"', '"eight"', "survived"),
    (8, "number < LIMIT", "number <= LIMIT", "killed"),
    (8, "number < LIMIT", "number <= LIMIT - 1", "survived"),
    (11, '"asked"', '"told"', "killed"),
    (14, "number + 1", "number + 2", "survived"),
]
RUN = """import json, os, sys
sys.path.append(sys.argv[1])
import mutation_runs
mutation_runs.BEGIN_S = 1
out = os.dup(1)
said = lambda mutant, became, seconds: os.write(out, f"{became}\\n".encode())
sys.path.insert(0, os.getcwd())
mutation_runs.run_module(["test_judge.py"], json.load(open("mutants.json")), said)
"""


@pytest.mark.slow
def test_each_mutant_gets_its_verdict_and_the_file_stays(tmp_path: Path) -> None:
    (tmp_path / "judge.py").write_text(JUDGE)
    (tmp_path / "test_judge.py").write_text(TESTS)
    mutants = [
        {"file": "judge.py", "line": str(line), "text": JUDGE.replace(old, new)}
        for line, old, new, _ in MUTANTS
    ]
    (tmp_path / "mutants.json").write_text(json.dumps(mutants))
    call = [sys.executable, "-c", RUN, str(TOP / "benchmarks")]
    ran = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ran.stdout.split(), ran.stderr) == ([became for *_, became in MUTANTS], "")
    assert (tmp_path / "judge.py").read_text() == JUDGE


@pytest.mark.slow
def test_tests_that_fail_without_a_mutant_are_told(tmp_path: Path) -> None:
    (tmp_path / "judge.py").write_text(JUDGE.replace("LIMIT = 3", "LIMIT = 2"))
    (tmp_path / "test_judge.py").write_text(TESTS)
    (tmp_path / "mutants.json").write_text(
        json.dumps([{"file": "judge.py", "line": "1", "text": JUDGE}])
    )
    call = [sys.executable, "-c", RUN, str(TOP / "benchmarks")]
    ran = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode
    assert "test_small_numbers_are_allowed" in (tmp_path / "said.txt").read_text()
    assert not ran.stdout
