"""Plans from many threads of one program, and from many programs that share one library.

    python benchmarks/threads.py [--threads N] [--plans N] [--load N] [--patience S]
    python benchmarks/threads.py --processes N [--plans N] [--database sqlite|postgresql]

With `--threads`, each thread asks for that many plans of bundled problems, of domains that are
grounded on trial in another process, and of goals that nothing reaches, while `--load` further
threads take memory and locks and give them back. With `--processes`, each is a program of its own
with a thread of its own in each of two pools, and all learn into one library. Each answer is
compared with the one that a program without threads gave. Exits with 1 if any differs, or if
nobody has answered for `--patience` seconds.
"""

import argparse
import logging
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from postgres import server

import cellwright
from cellwright.kb.asp import static_facts

TARGETS = ("themse/one", "bulkhead/one_point", "bulkhead/both_tools", "themse/unsolvable")
DOMAIN = """\
domain: wide
types: {thing: object}
objects: {thing: [t1..300]}
fluents:
  done(thing, thing, thing): {}
operators:
  act(A, B, C):
    where: A = B, B = C
    adds: done(A, B, C)
"""
PROBLEM = "problem: {name}\ndomain: wide\ngoals: ['done({goal})']\n"


def write_wide_domain(folder: Path) -> list[str]:
    """A domain that is grounded on trial, with a goal that can be reached and one that cannot."""
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(DOMAIN)
    for name, goal in (("can", "t7, t7, t7"), ("cannot", "t1, t2, t3")):
        (folder / "problems" / f"{name}.yaml").write_text(PROBLEM.format(name=name, goal=goal))
    return [str(folder / "problems" / f"{name}.yaml") for name in ("can", "cannot")]


def answer(target: str, store: str | None = None) -> str:
    """What a plan looks like: its status and its steps."""
    planned = cellwright.plan(target, store=store or "")
    return f"{planned.status} {target} {planned.plan.steps if planned.plan else ()}"


class Watch:
    """Counts answers, and ends the program if nobody has answered for some time."""

    def __init__(self, patience: float) -> None:
        self.patience, self.answers, self.last = patience, 0, time.monotonic()
        self.lock = threading.Lock()
        threading.Thread(target=self._look, daemon=True).start()

    def note(self) -> None:
        """One more answer."""
        with self.lock:
            self.answers, self.last = self.answers + 1, time.monotonic()

    def _look(self) -> None:
        while time.monotonic() - self.last < self.patience:
            time.sleep(1)
        print(f"nobody has answered for {self.patience:.0f} s, after {self.answers} answers")
        import faulthandler
        import os

        faulthandler.dump_traceback()
        os._exit(1)


def make_noise(stop: threading.Event) -> None:
    """Take locks and memory, as a program with many threads does."""
    logger = logging.getLogger("noise")
    logger.addHandler(logging.NullHandler())
    while not stop.is_set():
        logger.warning("%s", [bytearray(10_000) for _ in range(20)])
        threading.Thread(target=str, args=(1,)).start()
        time.sleep(0.001)


def run_threads(threads: int, plans: int, load: int, patience: float) -> int:
    """Plans from threads of this program; how many answers are wrong."""
    with tempfile.TemporaryDirectory() as folder:
        targets = [*TARGETS, *write_wide_domain(Path(folder))]
        right = {target: answer(target) for target in targets}
        stop, watch, began = threading.Event(), Watch(patience), time.monotonic()
        for _ in range(load):
            threading.Thread(target=make_noise, args=(stop,), daemon=True).start()

        def work(number: int) -> int:
            target = targets[number % len(targets)]
            if number % 7 == 0:
                static_facts._is_affordable.cache_clear()  # so that it is grounded on trial again
            wrong = answer(target) != right[target]
            watch.note()
            return int(wrong)

        with ThreadPoolExecutor(threads) as pool:
            wrong = sum(pool.map(work, range(threads * plans)))
        stop.set()
        took = time.monotonic() - began
    print(
        f"{threads} threads x {plans} plans beside {load}: {watch.answers} answers in {took:.1f} s,"
        f" {watch.answers / took:.1f} a second, {wrong} wrong"
    )
    return wrong


def run_program(plans: int, store: str) -> None:
    """One program with two threads that learns into a library; prints how many are wrong. The
    checker has accepted each plan; which one it is depends on what has been learned.
    """
    with ThreadPoolExecutor(2) as pool:
        made = pool.map(lambda n: cellwright.plan(TARGETS[n % 2], store=store), range(plans))
        answers = [planned.plan is not None for planned in made]
    print(answers.count(False), len(answers))


def run_processes(processes: int, plans: int, store: str) -> int:
    """Programs that share one library; how many answers are wrong or missing."""
    began = time.monotonic()
    command = [sys.executable, __file__, "--plans", str(plans), "--store", store]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(processes)]
    told = [process.communicate()[0].split() for process in running]
    took = time.monotonic() - began
    wrong, answered = (sum(int(each[i]) for each in told if len(each) == 2) for i in (0, 1))
    print(
        f"{processes} processes x {plans} plans: {answered} answers in {took:.1f} s,"
        f" {answered / took:.1f} a second, {wrong} wrong"
    )
    return wrong + processes * plans - answered


def main() -> int:
    """Run what the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=16)
    parser.add_argument("--plans", type=int, default=200)
    parser.add_argument("--load", type=int, default=16)
    parser.add_argument("--patience", type=float, default=300)
    parser.add_argument("--processes", type=int)
    parser.add_argument("--database", choices=("sqlite", "postgresql"), default="sqlite")
    parser.add_argument("--store", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.store:
        run_program(arguments.plans, arguments.store)
        return 0
    if not arguments.processes:
        return (
            run_threads(arguments.threads, arguments.plans, arguments.load, arguments.patience)
            and 1
        )
    if arguments.database == "postgresql":
        with server("") as database:
            return run_processes(arguments.processes, arguments.plans, database.url) and 1
    with tempfile.TemporaryDirectory() as folder:
        store = str(Path(folder) / "library.db")
        return run_processes(arguments.processes, arguments.plans, store) and 1


if __name__ == "__main__":
    sys.exit(main())
