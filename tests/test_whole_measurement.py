"""The whole measurement: parts are kept as they end, the next call goes on, failures are told,
and what got worse is found.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.places import TOP

sys.path.append(str(TOP / "benchmarks"))

import whole
import whole_page
import whole_runs
from whole_figures import EXACT, Figure, Output, Part, at, of, quantile, said, share, where
from whole_page import Machine, Measured
from whole_runs import Bench, Result, run_all

TIME = Figure(1, "time", at("s"), "s", 2.0, peer=("other", at("theirs")))
COUNT = Figure(2, "count", at("n"), "", 3.0, less=False, noise=EXACT)
MACHINE = Machine(2, "a processor", 8, "Linux", "3.11")


def script(folder: Path, name: str, text: str) -> str:
    file = folder / f"{name}.py"
    file.write_text(f"import json, pathlib, sys\n{text}\n")
    return str(file)


def counting(folder: Path, name: str, kept: dict[str, Any], more: str = "") -> Part:
    """A part that counts in a file how often it ran."""
    text = f"""
calls = pathlib.Path({str(folder / name)!r} + '.calls')
calls.write_text(calls.read_text() + '.' if calls.exists() else '.')
pathlib.Path(sys.argv[1]).write_text(json.dumps({kept!r}))
print('said 1,234 things')
{more}
"""
    return Part(name, script(folder, name, text), ("{json}",), ("{json}",), (TIME, COUNT))


def calls(folder: Path, name: str) -> int:
    file = folder / f"{name}.calls"
    return len(file.read_text()) if file.exists() else 0


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "kept", "quick", "v1", TOP)


def test_results_are_kept_and_the_next_call_goes_on(tmp_path: Path, bench: Bench) -> None:
    parts = [counting(tmp_path, name, {"s": 1.5, "n": 3, "theirs": 9}) for name in ("one", "two")]
    first = run_all(bench, parts[:1], 10, lambda _: None)
    both = run_all(bench, parts, 10, lambda _: None)
    assert both[0] == first[0]
    assert [each.figures for each in both] == [{"time": 1.5, "count": 3.0}] * 2
    assert both[0].peers == {"time": 9.0}
    assert (calls(tmp_path, "one"), calls(tmp_path, "two")) == (1, 1)


def test_other_sources_begin_anew(tmp_path: Path, bench: Bench) -> None:
    part = counting(tmp_path, "one", {"s": 1})
    run_all(bench, [part], 10, lambda _: None)
    run_all(replace(bench, version="v2"), [part], 10, lambda _: None)
    assert calls(tmp_path, "one") == 2


def test_an_interrupted_run_keeps_what_is_finished(
    tmp_path: Path, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = [counting(tmp_path, name, {"s": 1}) for name in ("one", "two")]
    carried_out = whole_runs._carried_out

    def interrupted(words: list[str], *rest: Any) -> Any:
        if words[1].endswith("two.py"):
            raise KeyboardInterrupt
        return carried_out(words, *rest)

    with monkeypatch.context() as patched:
        patched.setattr(whole_runs, "_carried_out", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_all(bench, parts, 10, lambda _: None)
    assert [each.part for each in run_all(bench, parts, 10, lambda _: None)] == ["one", "two"]
    assert (calls(tmp_path, "one"), calls(tmp_path, "two")) == (1, 1)


def test_a_failure_and_an_endless_part_stop_nothing(
    tmp_path: Path, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(whole_runs, "busy", lambda: 1.0)
    broken = Part("broken", script(tmp_path, "broken", "raise OSError('no peer')"), (), (), (TIME,))
    endless = Part(
        "endless", script(tmp_path, "endless", "while True: pass"), (), (), (TIME,), (0.01, 1)
    )
    silent = Part("silent", script(tmp_path, "silent", ""), (), (), (TIME,))
    missing = Part("missing", str(tmp_path / "nothing.py"), (), (), (TIME,))
    parts = [broken, endless, silent, missing, counting(tmp_path, "fine", {"s": 1})]
    found = {each.part: each.failed for each in run_all(bench, parts, 10, lambda _: None)}
    assert found["broken"].startswith("failed with exit code 1")
    assert "no peer" in found["broken"]
    assert found["endless"].startswith("ended after 1 s")
    assert found["silent"].startswith("it told none")
    assert found["missing"].startswith("failed with exit code 2")
    assert found["fine"] == ""


def test_a_bar_that_is_missed_is_no_failure(tmp_path: Path, bench: Bench) -> None:
    (found,) = run_all(
        bench, [counting(tmp_path, "slow", {"s": 5, "n": 1}, "sys.exit(1)")], 10, lambda _: None
    )
    assert (found.code, found.failed) == (1, "")


def test_parts_are_left_out_when_the_time_is_over(tmp_path: Path, bench: Bench) -> None:
    told: list[str] = []
    assert run_all(bench, [counting(tmp_path, "one", {"s": 1})], 0, told.append) == []
    assert told == ["one is left out: the 0 minutes are over"]


def test_a_place_that_is_not_there_takes_its_argument_along(tmp_path: Path, bench: Bench) -> None:
    text = "pathlib.Path(sys.argv[-1]).write_text(json.dumps({'s': len(sys.argv)}))"
    words = ("--peers={peers}", "--cluster={cluster}", "{json}")
    part = Part("peers", script(tmp_path, "peers", text), words, (), (TIME,))
    there = (
        {},
        {"peers": "python"},
        {"cluster": "host:8786"},
        {"peers": "python", "cluster": "host:8786"},
    )
    told = [
        run_all(replace(bench, version=f"v{n}", **places), [part], 10, lambda _: None)[0].figures[
            "time"
        ]
        for n, places in enumerate(there)
    ]
    assert told == [2.0, 3.0, 3.0, 4.0]


def measured(
    seconds: float | None, count: float | None, machine: Machine = MACHINE, failed: str = ""
) -> Measured:
    result = Result(
        "one", "v1", 0, 1.0, 1.0, 0.5, {"time": seconds, "count": count}, {"time": 4.0}, failed
    )
    return Measured("2026-11-23", "quick", "v1", machine, {"OMPL": "not installed"}, (result,))


PARTS = [Part("one", "one.py", (), (), (TIME, COUNT)), Part("left", "left.py", (), ())]


@pytest.mark.parametrize(
    ("now", "before", "said"),
    [
        (measured(1.2, 3), measured(1.0, 3), []),
        (measured(1.3, 3), measured(1.0, 3), ["time: 1.3 s, it was 1"]),
        (measured(2.5, 3), measured(1.9, 3), ["time: 2.5 s, it was 1.9 and misses its bar now"]),
        (measured(0.1, 3), measured(1.0, 3), []),
        (measured(1.0, 2), measured(1.0, 3), ["count: 2, it was 3 and misses its bar now"]),
        (
            measured(9.0, 2),
            measured(1.0, 3, replace(MACHINE, cores=64)),
            ["count: 2, it was 3 and misses its bar now"],
        ),
        (measured(None, None), measured(1.0, 3), []),
        (
            measured(None, None, failed="failed"),
            measured(1.0, 3),
            ["one fails; it did not the last time"],
        ),
        (measured(9.0, 1), None, []),
    ],
)
def test_what_got_worse_is_found(now: Measured, before: Measured | None, said: list[str]) -> None:
    assert list(whole_page.regressed(now, before, PARTS)) == said


def test_the_page_tells_everything() -> None:
    page = whole_page.page(measured(2.5, 3), measured(1.0, 3), PARTS)
    assert "# Figures, quick profile, 2026-11-23" in page
    assert "2 cores of a processor, 8 GB, Linux, Python 3.11." in page
    assert "| time | 2.5 s | at most 2 | **no** | 1 | 25% | other: 4 | one |" in page
    assert "| count | 3 | at least 3 | yes | 3 | 0% |  | one |" in page
    assert "- time: 2.5 s, it was 1 and misses its bar now" in page
    assert "- left" in page
    assert "| OMPL | not installed |" in page
    assert "only figures without noise" in whole_page.page(
        measured(1, 3), measured(1, 3, replace(MACHINE, cores=64)), PARTS
    )
    assert "There is no page to compare with." in whole_page.page(measured(1, 3), None, PARTS)
    assert "```\nwhy\n```" in whole_page.page(
        measured(None, None, failed="failed\nwhy"), None, PARTS
    )


def test_data_is_read_back() -> None:
    made = measured(1.0, 3)
    assert Measured.read(json.loads(json.dumps(made.document()))) == made


def test_a_whole_measurement_closes_and_the_next_one_compares(
    tmp_path: Path, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    def measure(seconds: float, parts: int = 2) -> int:
        all_parts = [counting(tmp_path, name, {"s": seconds, "n": 3}) for name in ("one", "two")]
        return whole.measure(bench, all_parts[:parts], 10, "2026-11-23", tmp_path)

    assert measure(1.0) == 0
    assert not (bench.folder / "quick").exists()
    assert measure(1.9) == 1
    assert "time: 1.9 s, it was 1" in capsys.readouterr().out
    assert "| 1.9 s |" in (bench.folder / "quick.md").read_text()
    assert "| 1 s |" in (bench.folder / "quick-before.md").read_text()
    assert calls(tmp_path, "one") == 2


def test_no_page_tells_hosts_or_paths() -> None:
    machine = whole_page.this_machine()
    import socket

    assert machine.cores > 0
    assert socket.gethostname() not in " ".join(map(str, whole_page.asdict(machine).values()))


def figures() -> Iterator[tuple[Part, Figure]]:
    return ((part, figure) for part in whole.PARTS for figure in part.figures)


def test_the_parts_are_there_and_their_figures_have_names_of_their_own() -> None:
    assert all((TOP / part.script).is_file() for part in whole.PARTS)
    names = [figure.what for _, figure in figures()]
    assert len(names) == len(set(names))
    assert len({part.name for part in whole.PARTS}) == len(whole.PARTS)
    assert all(part.full is not None for part in whole.PARTS)
    assert {figure.issue for _, figure in figures()} >= set(range(14, 28))


def test_every_benchmark_is_a_part() -> None:
    """Those that are no benchmark of their own are read by others, make pictures, or belong to
    this measurement.
    """
    helped = {"screenshots", "mutants", "mutation_runs", "limits_work", "inspection_patches"}
    # reuse beside planning, threads (docs/api.md), PDDL with times beside others, and those of
    # `make definition`, `robust`, `races`, `damage`, `soak`, `endings` and `misbehaviour`
    own = {
        "damage",
        "endings",
        "misbehaviour",
        "pddl_definition",
        "races",
        "robot_pddl",
        "robust_times",
        "routes",
        "soak",
        "temporal",
        "temporal_mutants",
        "threads",
    }
    files = {
        path.stem
        for path in (TOP / "benchmarks").glob("*.py")
        if '__name__ == "__main__"' in path.read_text()
    }
    covered = {Path(part.script).stem for part in whole.PARTS}
    assert files - covered - helped - own == {"whole"}


def test_figures_are_read_from_rows_and_texts() -> None:
    rows = Output([{"k": "a", "v": 1}, {"k": "b", "v": 4}, {"k": "b", "v": 2}], "x 1,234\nx 5")
    assert of(where("k", "b"), "v")(rows) == 4
    assert of(lambda kept: kept, "v", quantile(0.5))(rows) == 2
    assert of(where("k", "c"), "v")(rows) is None
    assert share(lambda row: row["v"] > 1)(rows) == pytest.approx(66.667, abs=0.01)
    assert said(r"x ([\d,]+)")(rows) == 5
    assert said(r"y (\d+)")(rows) is None
