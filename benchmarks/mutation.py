"""Mutation run: how many small faults, put into the modules that judge, do their tests notice?

    python benchmarks/mutation.py --mutators PYTHON [--seed N] [--count N] [--only TEXT] [--json FILE] [--again FILE]

PYTHON has cosmic-ray, which the product does not use; it makes the mutants (`mutants.py`). Each mutant runs the tests of
its module alone, on a copy of the tree. One process for each file has imported what does not depend on that file, and
forks for each mutant, so that a run costs its tests and little more. Laws try all of their examples. With --again only those
mutants run that survived, or were not tried, by the JSON of an earlier run. Exits with 1 below 85 %.
"""

import argparse
import difflib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mutation_modules import MODULES

if TYPE_CHECKING:
    import grimp

TOP = Path(__file__).resolve().parents[1]
PASS = 0.85
MEMORY = 12 << 30  # bytes of address space for one run
UNLIMITED = 3600  # seconds
SAID = "said.txt"  # what the last run printed


@dataclass(frozen=True)
class Verdict:
    """What became of one mutant: killed, survived, or timeout; `diff` shows it, `seconds` are of processor time."""

    module: str
    file: str
    line: int
    operator: str
    became: str
    seconds: float
    diff: str


def main() -> None:
    given = _arguments()
    files = {
        str(path.relative_to(TOP)): module
        for module, (patterns, _) in MODULES.items()
        for pattern in patterns
        for path in sorted(TOP.glob(pattern))
    }
    made = [given.mutators, "benchmarks/mutants.py", f"--seed={given.seed}", f"--count={given.count}", *files]
    mutants = json.loads(subprocess.run(made, cwd=TOP, check=True, capture_output=True).stdout)
    known = _noticed(given.again)
    verdicts: list[Verdict] = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        _copied(copy)
        for file, module in files.items():
            if given.only not in module:
                continue
            own = [each for each in mutants if each["file"] == file]
            before = [known[key] for each in own if (key := _key(each)) in known]
            new = [each for each in own if _key(each) not in known]
            found = [*before, *(_tried(copy, file, module, new) if new else [])]
            verdicts += found
            print(f"{file}: {_said(found)}", flush=True)
            _keep(given.json, given.seed, verdicts)
    report(verdicts)
    sys.exit(score(verdicts) < PASS)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mutators", required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--only", default="")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--again", type=Path)
    return parser.parse_args()


def _noticed(file: Path | None) -> dict[tuple[str, str], Verdict]:
    """The mutants that an earlier run noticed, by file and difference."""
    told = json.loads(file.read_text())["mutants"] if file else []
    return {(each["file"], each["diff"]): Verdict(**each) for each in told if each["became"] != "survived"}


def _key(mutant: dict[str, str]) -> tuple[str, str]:
    original = (TOP / mutant["file"]).read_text()
    return mutant["file"], "".join(_difference(original, mutant["text"]))


def _copied(copy: Path) -> None:
    """The tree as it stands, with what is compiled."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=TOP, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    compiled = (str(path.relative_to(TOP)) for path in TOP.glob("engine/**/*.so"))
    for name in (*listed, *compiled):
        if (TOP / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, copy / name)


def _tried(copy: Path, file: str, module: str, mutants: Sequence[dict[str, str]]) -> list[Verdict]:
    """The verdicts on the mutants of one file."""
    out = copy / "verdicts.json"
    child = os.fork()
    if not child:
        try:
            out.write_text(json.dumps([asdict(each) for each in _run_all(copy, file, module, mutants)]))
        except BaseException as error:  # the parent goes on only with an answer
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            os._exit(2)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        raise SystemExit(f"the mutants of {file} could not be tried")
    return [Verdict(**each) for each in json.loads(out.read_text())]


def _run_all(copy: Path, file: str, module: str, mutants: Sequence[dict[str, str]]) -> Iterator[Verdict]:
    os.chdir(copy)
    sys.path.insert(0, str(copy))
    os.environ["PYTHONPATH"] = str(copy)
    tests = MODULES[module][1]
    became, _ = _run(tests, UNLIMITED)  # compiles and caches what the tests need
    if became != "survived":
        raise SystemExit(f"{Path(SAID).read_text()}\nthe tests of {module} fail without any mutant")
    _warm(file)
    _, usual = _run(tests, UNLIMITED)
    original = Path(file).read_text()
    for mutant in mutants:
        Path(file).write_text(mutant["text"])
        became, seconds = _run(tests, 10 + 3 * round(usual))
        diff = "".join(_difference(original, mutant["text"]))
        yield Verdict(module, file, int(mutant["line"]), mutant["operator"], became, round(seconds, 2), diff)
    Path(file).write_text(original)


def _warm(file: str) -> None:
    """Import all of the product that does not depend on a file, and nothing that imports it by the way."""
    import importlib

    import grimp
    import pytest  # noqa: F401
    from hypothesis import settings  # noqa: F401

    graph = grimp.build_graph("kb", "engine", cache_dir=None)
    name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    barred = _importers(graph, name)
    for each in sorted(graph.modules - barred):
        if ".cli" in each:
            continue
        try:
            importlib.import_module(each)
        except ImportError:
            continue  # what is optional is not installed
    assert name not in sys.modules, name


def _importers(graph: "grimp.ImportGraph", name: str) -> set[str]:
    """A module, and what imports it. Whoever imports a module imports the packages that it lies in, too."""
    found, new = set[str](), {name}
    while new:
        found |= new
        within = new.union(*map(graph.find_descendants, new))
        new = within.union(*map(graph.find_downstream_modules, within)) - found
    return found


def _run(tests: Sequence[str], limit: int) -> tuple[str, float]:
    """Run tests in a fork of this process until one fails; what came of it, and its seconds.

    `limit` is in seconds of processor time, as is what comes back: others may use the machine.
    """
    before = _spent()
    child = os.fork()
    if not child:
        _become_a_run(tests, limit)
    status, patience = _waited(child, time.monotonic() + 20 * limit)
    spent = _spent() - before
    if not patience or (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU):
        return "timeout", spent
    return "killed" if status else "survived", spent


def _waited(child: int, until: float) -> tuple[int, bool]:
    """The status with which a process ends, and whether it ends by itself."""
    while time.monotonic() < until:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return status, True
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1], False


def _spent() -> float:
    """Seconds of processor time of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _become_a_run(tests: Sequence[str], limit: int) -> None:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    sys.dont_write_bytecode = limit < UNLIMITED
    said = os.open(SAID, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    import pytest
    from hypothesis import Phase, settings

    settings.register_profile("mutation", database=None, phases=(Phase.explicit, Phase.generate))
    plain = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "--hypothesis-profile=mutation"]
    plain += [
        "-m",
        "not (slow or long)",
    ]  # unlike the quick suite, which lets laws try a share of their examples
    plain += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what was imported before the fork
    os._exit(int(pytest.main([*plain, *tests])))


def _difference(original: str, mutated: str) -> Iterator[str]:
    lines = difflib.unified_diff(original.splitlines(True), mutated.splitlines(True), n=1)
    return (line for line in lines if not line.startswith(("---", "+++")))


def score(verdicts: Sequence[Verdict]) -> float:
    """The share that was noticed; a run without end is noticed, too."""
    return sum(each.became != "survived" for each in verdicts) / len(verdicts) if verdicts else 1.0


def _said(verdicts: Sequence[Verdict]) -> str:
    counts = Counter(each.became for each in verdicts)
    shares = ", ".join(f"{counts[kind]} {kind}" for kind in ("killed", "timeout", "survived"))
    return f"{shares}; {score(verdicts):.1%} of {len(verdicts)}"


def report(verdicts: Sequence[Verdict]) -> None:
    """Print every survivor, then the figures for each module."""
    for each in verdicts:
        if each.became == "survived":
            print(f"\n{each.file}:{each.line} {each.operator}\n{each.diff}", end="")
    print()
    for module in MODULES:
        own = [each for each in verdicts if each.module == module]
        if own:
            print(f"{module:30} {_said(own)}")
    print(f"{'all':30} {_said(verdicts)}")


def _keep(file: Path | None, seed: int, verdicts: Sequence[Verdict]) -> None:
    if file is not None:
        file.write_text(json.dumps({"seed": seed, "mutants": [asdict(each) for each in verdicts]}, indent=1))


if __name__ == "__main__":
    main()
