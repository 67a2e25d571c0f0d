"""A command waits for nothing that it does not use."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ("networkx", "numpy", "ortools", "sqlalchemy")
DOMAIN = """
(define (domain lamps) (:predicates (lamp ?l) (lit ?l))
  (:action switch :parameters (?l) :precondition (and (lamp ?l) (not (lit ?l))) :effect (lit ?l)))
"""
PROBLEM = "(define (problem one) (:domain lamps) (:objects l) (:init (lamp l)) (:goal (lit l)))"


@pytest.mark.parametrize("strategy", ["auto", "landmarks"])
def test_a_plain_plan_loads_nothing_of_other_commands(tmp_path: Path, strategy: str) -> None:
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(DOMAIN)
    problem.write_text(PROBLEM)
    loaded = loaded_by("plan", "--pddl", str(domain), str(problem), "--strategy", strategy)
    assert (
        loaded
        & {*HEAVY, "lark", "pydantic", "yaml", "cellwright.engine.formats.report.plans.gantt_chart"}
        == set()
    )


@pytest.mark.slow
def test_a_plan_for_a_problem_of_our_own_loads_no_store_and_no_kernels_of_geometry() -> None:
    assert loaded_by("plan", "bulkhead/one_point") & set(HEAVY) == set()


def loaded_by(*command: str) -> set[str]:
    """The modules that a command in a process of its own has loaded when it ends."""
    code = "import atexit, sys; from cellwright.engine.faces.cli import main"
    code += "; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); main()"
    ran = subprocess.run(
        [sys.executable, "-c", code, *command], capture_output=True, text=True, check=True
    )
    return set(ran.stderr.split())


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        (("plan", "bulkhead/one_point"), 0, "move_retract"),
        pytest.param(("plan", "bulkhead/tool_missing"), 10, "No plan", marks=pytest.mark.slow),
        pytest.param(("plan", "nothing"), 2, "nothing", marks=pytest.mark.slow),
        (("--no-such-option",), 2, "No such option"),
    ],
)
def test_what_ends_at_once_has_written_its_answer_and_keeps_its_exit_code(
    command: tuple[str, ...], code: int, said: str
) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "cellwright.engine.faces.cli", *command],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == code
    assert said in ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ("before", "code", "said"),
    [
        ("pass", 3, ""),
        ("import atexit; atexit.register(print, 'cleaned up')", 3, "cleaned up"),
        (
            "import threading; threading.Timer(0.2, print, ['thread']).start()",
            0,
            "came back thread",
        ),
    ],
)
def test_what_is_open_is_closed_before_the_end(before: str, code: int, said: str) -> None:
    """`leave` comes back only if threads run, so that the interpreter ends as usual; otherwise
    nothing after it runs.
    """
    script = (
        "import sys; from cellwright.engine.faces.cli.output.answer_output import "
        f"leave_process; {before}; leave_process(3); print('came back')"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, " ".join(ran.stdout.split())) == (code, said)
