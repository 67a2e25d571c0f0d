"""Kills a run at every record of its journal while its controller lives on, resumes it, and reads the controller's own log.

    python benchmarks/kills.py [--target TARGET] [--fault STEP=CAUSE] [--from N] [--every N] [--at-most N] [--json FILE]

The simulated cell is a process of its own, reached over TCP. The process of the run gets SIGKILL when it has told so many records.
The resumed run has to reach the same goals, and no command may have been carried out twice. With --json the kills that have
passed are kept, and are not made again by the next call. Exits with 1 if a kill ends wrong.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

CLI = [sys.executable, "-m", "engine.faces.cli"]
TOP = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TOP), os.environ.get("PYTHONPATH", "")])}


def killed_after(records: int, line: list[str]) -> bool:
    """Run a command line that writes records to its output, and kill it after so many; whether it was still running."""
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT) as run:
        assert run.stdout is not None
        seen = [each for each, _ in zip(run.stdout, range(records), strict=False)]
        run.kill()
    return len(seen) == records and json.loads(seen[-1])["kind"] != "end"


def trial(target: str, fault: str, records: int, folder: Path) -> tuple[bool, str]:
    """Whether the run was killed before its end, and what is wrong afterwards; nothing if all is well."""
    log = folder / "cell.log"
    serve = [*CLI, "driver", "serve", target, "--listen", "127.0.0.1:0", "--option", f"log={log}"]
    serve += ["--fault", fault] if fault else []
    with subprocess.Popen(serve, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT) as cell:
        assert cell.stderr is not None
        address = cell.stderr.readline().split()[-1]
        try:
            kept = ["--store", str(folder / "runs.db")]
            line = [*CLI, "run", target, "--name", "k", *kept, "--events", "-", "--driver", "external"]
            if not killed_after(records, [*line, "--option", f"address={address}"]):
                return False, ""
            again = [*CLI, "resume", "k", *kept, "--format", "json"]
            ended = subprocess.run(again, capture_output=True, text=True, env=ENVIRONMENT, check=False)
        finally:
            cell.kill()
    return True, wrong_with(ended.returncode, ended.stdout + ended.stderr, log)


def wrong_with(code: int, said: str, log: Path) -> str:
    """What is wrong with a resumed run."""
    if code:
        return f"resume ended with {code}: {said[-300:]}"
    entries = [json.loads(each) for each in log.read_text("utf-8").splitlines() if each]
    twice = [n for n, count in Counter(e["ended"] for e in entries if "ended" in e).items() if count > 1]
    return f"commands carried out twice: {twice}" if twice else ""


def main() -> int:
    """Kill at every record, and print what went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--target", default="themse/one")
    parser.add_argument("--fault", default="pick=not_gripped")
    parser.add_argument("--from", dest="first", type=int, default=2)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--at-most", type=int)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    kept = asked.json is not None and asked.json.is_file()
    passed = set(json.loads(asked.json.read_text("utf-8"))) if kept else set[int]()
    wrong, made, records = 0, 0, asked.first
    while asked.at_most is None or made < asked.at_most:
        if records not in passed:
            with tempfile.TemporaryDirectory() as folder:
                killed, found = trial(asked.target, asked.fault, records, Path(folder))
            if not killed:
                break
            made += 1
            wrong += bool(found)
            passed |= set() if found else {records}
            print(f"  killed after {records} records: {found or 'resumed, nothing done twice'}", flush=True)
            if asked.json:
                asked.json.write_text(json.dumps(sorted(passed)) + "\n", "utf-8")
        records += asked.every
    print(f"{made} kills, {wrong} ended wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
