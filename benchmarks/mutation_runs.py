"""Runs of the tests of one module on its mutants, in one process that has imported and collected
all of it once.

Each test runs once by itself, in a fork, while the lines that it reaches are noted; then all run
one after another, without tracing, for their costs. For each mutant this process forks, puts the
changed code into the functions that have it, and runs those tests that reach the mutant, the
cheapest first, until one fails. What a mutant changes beside the body of a function, and what runs
while tests are collected, cannot be exchanged afterwards: then all is imported anew.

    python benchmarks/mutation_runs.py FILE

is such a new process: FILE says which tests run, and where they are.
"""

import contextlib
import gc
import json
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import CodeType, FunctionType

import pytest
from hypothesis import HealthCheck, Phase, settings
from mutation_forks import (
    BEGIN_S,
    IMPORT_S,
    SAID,
    SLACK,
    Became,
    fork,
    limit_memory,
    patience_s,
    say,
    waited,
)
from mutation_reach import Measured, Tracer, chosen, replaced, statement

ANEW = "anew.json"
Mutant = Mapping[str, str]
Told = Callable[[Mutant, str, float], None]  # what became of a mutant


def run_module(tests: Sequence[str], mutants: Sequence[Mutant], told: Told) -> None:
    """Try mutants in this process, which has imported nothing of the product; the working
    folder is a copy of the tree.
    """
    files = sorted({each["file"] for each in mutants})
    trial = Trial(tests, mutants, told, Tracer(str(Path(file).absolute()) for file in files))
    trial.tracer.on()
    if code := _pytest(tests, trial):
        raise SystemExit(f"{Path(SAID).read_text()}\npytest ended with {code} without any mutant")


def _pytest(tests: Sequence[str], plugin: object) -> int:
    """Laws try all of their examples, and nothing depends on how busy the machine is."""
    said = os.open(SAID, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    settings.register_profile(
        "mutation",
        database=None,
        deadline=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=[HealthCheck.too_slow],
    )
    plain = [
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--hypothesis-seed=0",
        "--hypothesis-profile=mutation",
    ]
    marks = [
        "-m",
        "not (slow or long)",
    ]  # no word of the quick suite, where laws try a share of their examples
    return int(pytest.main([*plain, *marks, *tests], plugins=[plugin]))


@dataclass
class Trial:
    """A pytest plugin: in place of running the tests once, it runs them on each mutant."""

    tests: Sequence[str]
    mutants: Sequence[Mutant]
    told: Told
    tracer: Tracer

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Look at the tests, then try the mutants."""
        self.tracer.off()
        early = self.tracer.lines() or {}  # what has run before any test: each test has reached it
        items = {each.nodeid: each for each in session.items}
        functions = _functions(frozenset(early))
        tests = _timed(session, [_traced(session, each, early) for each in session.items])
        for mutant in self.mutants:
            file = str(Path(mutant["file"]).absolute())
            lines = statement(Path(file).read_text(), int(mutant["line"]))
            own = chosen(tests, file, lines)
            known = early[file].isdisjoint(lines)
            codes = _exchange(file, mutant["text"], functions) if known else None
            with _written(
                Path(file), mutant["text"]
            ):  # on disk as well, for the processes that a test starts
                if not own:
                    became = "survived", 0.0
                elif codes is None:
                    became = _anew(self.tests, own)
                else:
                    became = _forked(
                        session, [(items[each.name], each.seconds) for each in own], codes
                    )
            self.told(mutant, *became)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Why a test fails is told at once, since pytest does not come to its summary."""
        if report.failed:
            say(f"{report.nodeid}\n{report.longreprtext}\n")


@contextlib.contextmanager
def _written(file: Path, text: str) -> Iterator[None]:
    """Within `with`, a file has another text."""
    before = file.read_text()
    file.write_text(text)
    try:
        yield
    finally:
        file.write_text(before)


Exchange = tuple[Sequence[FunctionType], CodeType]  # functions, and the code that each of them gets


def _functions(files: frozenset[str]) -> list[FunctionType]:
    """The functions of these files, bare or within whatever decorates them."""
    gc.unfreeze()
    found = [each for each in gc.get_objects() if isinstance(each, FunctionType)]
    gc.freeze()
    return [each for each in found if each.__code__.co_filename in files]


def _exchange(file: str, text: str, functions: Sequence[FunctionType]) -> Exchange | None:
    """Which functions get which code, if that is all that the mutant changes."""
    codes = replaced(Path(file).read_text(), text, file)
    if codes is None:
        return None
    found = [
        each
        for each in functions
        if each.__code__ == codes[0] and each.__code__.co_filename == file
    ]
    return (found, codes[1]) if found else None


def _traced(
    session: pytest.Session, item: pytest.Item, early: Mapping[str, frozenset[int]]
) -> Measured:
    """One test by itself: what it takes while it is traced, and what it reaches."""
    tracer = Tracer(early)

    def run() -> object:
        tracer.watch_processes()
        tracer.on()
        _run_items(session, [item])
        tracer.off()
        lines = tracer.lines()
        return lines and {file: sorted(reached) for file, reached in lines.items()}

    found, seconds = _answered(run, item.nodeid)
    lines = (
        {file: early[file].union(found[file]) for file in early}
        if isinstance(found, dict)
        else None
    )
    return Measured(item.nodeid, seconds, lines)


def _timed(session: pytest.Session, tests: Sequence[Measured]) -> list[Measured]:
    """The same tests with what they take in one run, without tracing, the cheapest first."""
    items = {each.nodeid: each for each in session.items}
    order = sorted(tests, key=lambda each: each.seconds)

    def run() -> object:
        times = _Times()
        session.config.pluginmanager.register(times)
        _run_items(session, [items[each.name] for each in order])
        return times.seconds

    found, _ = _answered(run, "all tests")
    assert isinstance(found, dict)
    return [replace(each, seconds=found[each.name]) for each in tests]


@dataclass
class _Times:
    """A pytest plugin: the processor time of each test."""

    seconds: dict[str, float]

    def __init__(self) -> None:
        self.seconds = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """One test, from setup to teardown."""
        before = time.process_time()
        found = yield
        self.seconds[item.nodeid] = time.process_time() - before
        return found


def _answered(run: Callable[[], object], what: str) -> tuple[object, float]:
    """What a function returns in a fork, through JSON, and the processor time that it takes."""
    answer = Path("answer.json")

    def answered() -> None:
        answer.write_text(json.dumps(run()))

    became, seconds = waited(fork(answered), math.inf)
    if became != "survived":
        raise SystemExit(f"{Path(SAID).read_text()}\n{what}: {became} without any mutant")
    return json.loads(answer.read_text()), seconds


def _forked(
    session: pytest.Session, run: Sequence[tuple[pytest.Item, float]], codes: Exchange
) -> Became:
    """What becomes of a mutant that is other code for functions, by tests and what they usually
    take.
    """

    def mutated() -> None:
        for function in codes[0]:
            function.__code__ = codes[1]
        session.config.pluginmanager.register(
            Limits({item.nodeid: cost for item, cost in run}, BEGIN_S)
        )
        _run_items(session, [item for item, _ in run])

    return waited(fork(mutated), patience_s(sum(cost for _, cost in run)))


def _anew(files: Sequence[str], tests: Sequence[Measured]) -> Became:
    """What becomes of the mutant that is on disk, in a process that imports all; other tests
    run after these.
    """
    costs = {each.name: each.seconds for each in tests}
    Path(ANEW).write_text(json.dumps({"files": list(files), "costs": costs}))
    run = subprocess.Popen([sys.executable, "-B", __file__, ANEW], start_new_session=True)
    became = waited(run.pid, patience_s(IMPORT_S + sum(costs.values())))
    run.returncode = 0  # it was waited for
    return became


def main() -> None:
    """Run tests in an order with their limits, in this new process."""
    given = json.loads(Path(sys.argv[1]).read_text())
    sys.path.insert(0, str(Path.cwd()))
    limit_memory()
    os._exit(_pytest(given["files"], Limits(given["costs"], IMPORT_S)))


class Limits:
    """A pytest plugin: the order of tests by name, and the limit of processor time.

    At each moment it is a constant and some times what the tests take that have begun: so a run
    without end costs little.
    """

    def __init__(self, costs: Mapping[str, float], begin_s: float) -> None:
        self.costs, self.limit_s = costs, begin_s
        self._set()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """The cheapest tests first."""
        items.sort(key=lambda each: self.costs.get(each.nodeid, math.inf))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> None:
        """One more test begins."""
        self.limit_s += SLACK * self.costs.get(item.nodeid, BEGIN_S)
        self._set()

    def _set(self) -> None:
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(self.limit_s), most))


def _run_items(session: pytest.Session, items: Sequence[pytest.Item]) -> None:
    """Run tests until one fails, which ends this fork."""
    for item, after in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        if session.testsfailed:
            raise SystemExit(1)


if __name__ == "__main__":
    main()
