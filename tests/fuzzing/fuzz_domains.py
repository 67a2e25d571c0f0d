"""Cases of whole domains (read, grounded, planned) and of whole command lines, each in a
process of its own.
"""

import atexit
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

import fuzz_seeds as seeds
from fuzz_guards import MEGABYTES, SECONDS
from mutations import mutated

from cellwright.kb.diagnostics import InvalidInput

KINDS = {".yaml": "yaml", ".lp": "text"}
EXPECTED = {0, 1, 2, 10, 12, 23, 40}  # all but "interrupted" and "internal error"
LIMITS = ["--time-limit", "5", "--memory-limit", "1500"]
COMMANDS = [
    ["plan", "PROBLEM"],
    ["plan", "PROBLEM", "--format", "json"],
    ["plan", "DOMAIN", "--command", "SENTENCE"],
    ["plan", "PROBLEM", "--strategy", "asp"],
    ["plan", "PROBLEM", "--store", "STORE"],
    ["check", "PROBLEM"],
    ["check", "DOMAIN", "--format", "json"],
    ["schedule", "PROBLEM"],
    ["explain", "PROBLEM"],
    ["export", "pddl", "PROBLEM", "--output", "OUT"],
    ["diagnose", "DOMAIN", "--format", "json"],
    ["prepare", "PROBLEM", "--jobs", "1", "--store", "STORE"],
    ["states", "DOMAIN"],
    ["sequence", "PROBLEM"],
    ["cell", "check", "CELL"],
    ["cell", "show", "CELL", "--output", "OUT.svg"],
    ["test", "DOMAIN"],
    ["run", "PROBLEM", "--store", "STORE", "--format", "json"],
    ["validate", "PROBLEM", "PLAN"],
    ["macros", "import", "PLAN", "--store", "STORE"],
    ["macros", "learn", "PLAN", "--store", "STORE"],
]


def _changed(chance: Random, folder: Path) -> Path:
    """A copy of a cell in a folder, with one or two files mutated; returns the cell's folder."""
    cell = chance.choice(seeds.CELLS)
    copy = folder / cell.name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(cell, copy, ignore=shutil.ignore_patterns("golden", "large", "__pycache__"))
    found = sorted(path for path in copy.rglob("*") if path.suffix in KINDS)
    for path in chance.sample(found, min(chance.choice((1, 1, 2)), len(found))):
        same = [each.read_bytes() for each in found if each.suffix == path.suffix]
        path.write_bytes(mutated(chance, KINDS[path.suffix], [path.read_bytes(), *same[:1]]))
    return copy


def _problem(chance: Random, cell: Path) -> Path:
    return chance.choice([*sorted(cell.glob("problems/*.yaml")), cell / "domain.yaml"])


def domains(seed: int, folder: Path) -> Callable[[int], bool]:
    """Cases in process: a mutated cell is loaded, checked and grounded, and a small problem is
    planned.
    """
    from cellwright.engine.pipelines.planning.checked_plan import plan_problem
    from cellwright.engine.pipelines.planning.target_files import load_target
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb import stopping

    def case(number: int) -> bool:
        chance = Random(f"{seed}/whole domains/{number}")
        target = _problem(chance, _changed(chance, folder))
        end = time.process_time() + 5
        try:
            with stopping.asking_to_stop(lambda: time.process_time() > end):
                found = load_target(target)
                if found.problem is not None:
                    plan_problem(
                        found.problem,
                        SearchLimits(300, interrupted=lambda: time.process_time() > end),
                    )
        except (InvalidInput, stopping.StoppedByCaller):
            return False
        return True

    return case


def commands(seed: int, folder: Path) -> Callable[[int], bool]:
    """Cases through the command line, in a process forked from this one, which has the modules
    loaded.
    """

    def case(number: int) -> bool:
        arguments = written("command lines", seed, number, folder)
        began = time.monotonic()
        sys.stderr.flush()
        child = os.fork()
        if child == 0:
            _command(arguments, folder)
        while not (found := os.wait4(child, os.WNOHANG))[0]:
            time.sleep(0.02)
            if time.monotonic() - began > 20 * SECONDS:
                os.kill(child, signal.SIGKILL)
        _, status, usage = found
        said = (folder / "stderr").read_text("utf-8", "replace")
        code, spent = os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime
        assert code in EXPECTED, f"exit {code} of {arguments}: {said[-300:]}"
        assert "Traceback" not in said, f"{arguments}: {said[-300:]}"
        assert spent < SECONDS, f"{arguments} took {spent:.1f} s"
        assert usage.ru_maxrss / 1024 < MEGABYTES, (
            f"{arguments} took {usage.ru_maxrss / 1024:.0f} MB"
        )
        hidden = [
            each for each in said if (each < " " and each not in "\n\t") or "\x7f" <= each < "\xa0"
        ]
        assert not hidden, f"{arguments}: control characters in the answer"
        return code == 0

    return case


def _command(arguments: list[str], folder: Path) -> None:
    from cellwright.engine.faces.cli import main

    # the end of a command must not delete the folder of the campaign that it was forked from
    atexit._clear()
    out = os.open(folder / "stdout", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    said = os.open(folder / "stderr", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    os.dup2(out, 1)
    os.dup2(said, 2)
    sys.stdout, sys.stderr = (
        os.fdopen(each, "w", encoding="utf-8", errors="replace") for each in (1, 2)
    )
    sys.argv = ["cellwright", *arguments]
    code = 70
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 2
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def written(name: str, seed: int, number: int, folder: Path) -> list[str]:
    """The arguments of a case of the command line, whose files are written into a folder."""
    chance = Random(f"{seed}/{name}/{number}")
    cell = _changed(chance, folder)
    plans = [*seeds.files("*.json", seeds.TOP / "domains"), seeds.MACROPS.encode()]
    (folder / "plan.json").write_bytes(mutated(chance, "json", plans))
    store = folder / "store.db"
    if chance.random() < 0.8:
        store.unlink(missing_ok=True)
    words = {
        "PROBLEM": str(_problem(chance, cell)),
        "DOMAIN": str(cell / "domain.yaml"),
        "CELL": str(cell),
        "STORE": str(store),
        "PLAN": str(folder / "plan.json"),
        "OUT": str(folder / "out"),
        "OUT.svg": str(folder / "out.svg"),
        "SENTENCE": mutated(chance, "text", [each.encode() for each in seeds.SENTENCES]).decode(
            "utf-8", "replace"
        ),
    }
    arguments = [words.get(each, each).replace("\0", "") for each in chance.choice(COMMANDS)]
    return [*arguments, *LIMITS]
