"""Mutation run: how many small faults, put into the modules that judge, do their tests notice?

    python benchmarks/mutation.py --mutators PYTHON [--seed N] [--count N] [--only TEXT...]
        [--json FILE] [--again FILE...]

PYTHON has cosmic-ray, which the product does not use; it makes the mutants (`mutants.py`). Each
mutant runs the tests of its module, on a copy of the tree. All laws try all of their examples.

A run costs what it needs for a verdict, and no more. One process for each module imports and
collects its tests once, notes which lines each test reaches, and forks for each mutant
(`mutation_runs.py`). Only those tests run that reach the statement with the mutant, the cheapest
first, until one fails. The others do the same with the mutant as without it, so that the verdict is
that of all tests. What runs while tests are collected is reached by all of them. A mutant that no
test reaches survives.

With --again only those mutants run that survived, or were not tried, by the JSON of earlier runs.
Exits with 1 below 85 %.
"""

import argparse
import difflib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mutation_modules import MODULES
from mutation_runs import run_module

TOP = Path(__file__).resolve().parents[1]
PASS = 0.85


@dataclass(frozen=True)
class Verdict:
    """What became of one mutant: killed, survived, or timeout; `diff` shows it, `seconds` are
    of processor time.
    """

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
    made = [
        given.mutators,
        "benchmarks/mutants.py",
        f"--seed={given.seed}",
        f"--count={given.count}",
        *files,
    ]
    mutants = json.loads(subprocess.run(made, cwd=TOP, check=True, capture_output=True).stdout)
    known = _noticed(given.again)
    verdicts: list[Verdict] = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve()
        _copied(copy)
        for module in (each for each in MODULES if any(text in each for text in given.only)):
            own = [
                each
                for file in files
                if files[file] == module
                for each in mutants
                if each["file"] == file
            ]
            verdicts += [known[key] for each in own if (key := _key(each)) in known]
            new = [each for each in own if _key(each) not in known]
            for verdict in _tried(copy, module, new) if new else ():
                verdicts.append(verdict)
                _keep(given.json, given.seed, verdicts)
            print(
                f"{module}: {_said([each for each in verdicts if each.module == module])}",
                flush=True,
            )
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
    parser.add_argument("--only", nargs="+", default=[""])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--again", type=Path, nargs="+", default=())
    return parser.parse_args()


def _noticed(files: Sequence[Path]) -> dict[tuple[str, str], Verdict]:
    """The mutants that earlier runs noticed, by file and difference."""
    told = [each for file in files for each in json.loads(file.read_text())["mutants"]]
    return {
        (each["file"], each["diff"]): Verdict(**each)
        for each in told
        if each["became"] != "survived"
    }


def _key(mutant: Mapping[str, str]) -> tuple[str, str]:
    original = (TOP / mutant["file"]).read_text()
    return mutant["file"], "".join(_difference(original, mutant["text"]))


def _copied(copy: Path) -> None:
    """The tree as it stands, with what is compiled."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=TOP,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()
    compiled = (str(path.relative_to(TOP)) for path in TOP.glob("engine/**/*.so"))
    for name in (*listed, *compiled):
        if (TOP / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, copy / name)


def _tried(copy: Path, module: str, mutants: Sequence[Mapping[str, str]]) -> Iterator[Verdict]:
    """The verdicts on mutants of one module, each as soon as it is known.

    A process of its own finds them.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _be_tried(copy, module, mutants, writing)
    os.close(writing)
    with os.fdopen(reading) as lines:
        yield from (Verdict(**json.loads(line)) for line in lines)
    if os.waitpid(child, 0)[1]:
        raise SystemExit(f"the mutants of {module} could not be tried")


def _be_tried(copy: Path, module: str, mutants: Sequence[Mapping[str, str]], out: int) -> None:
    def told(mutant: Mapping[str, str], became: str, seconds: float) -> None:
        file, line = mutant["file"], int(mutant["line"])
        verdict = Verdict(
            module, file, line, mutant["operator"], became, round(seconds, 2), _key(mutant)[1]
        )
        os.write(out, f"{json.dumps(asdict(verdict))}\n".encode())

    errors, code = os.dup(2), 2
    try:
        os.chdir(copy)
        sys.path.insert(0, str(copy))
        os.environ["PYTHONPATH"] = str(copy)
        run_module(MODULES[module][1], mutants, told)
        code = 0
    except BaseException as error:  # the parent goes on only with an answer
        os.write(errors, f"{type(error).__name__}: {error}\n".encode())
    os._exit(code)


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
        file.write_text(
            json.dumps({"seed": seed, "mutants": [asdict(each) for each in verdicts]}, indent=1)
        )


if __name__ == "__main__":
    main()
