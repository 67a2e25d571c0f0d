"""Kept sequences: what is done stays, the rest is what remains, and two processes lose nothing."""

import json
import multiprocessing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.tour_problem import cost_of, times_of, tour_violations
from cellwright.engine.pipelines.inspection.arm_capabilities import partition_after_loss
from cellwright.engine.pipelines.inspection.tour_progress import (
    KeptSequenceProgress,
    SequenceNews,
    carry_on_sequence,
)
from cellwright.engine.pipelines.planning.decomposition.kept_sequences import carry_on
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.inspection_store import SequencePlan, Sequences

QUICK = TourLimits(work=50, proof=0.0)
NAMES = [f"p{number}" for number in range(14)]


def written(folder: Path, names: list[str], shift: float = 0.0, statics: str = "") -> Path:
    """A problem file; every third point is for the laser."""
    kinds = {name: "profile" if int(name[1:]) % 3 == 0 else "thickness" for name in names}
    rows = [
        f"{name},{37 * int(name[1:]) % 101 + shift},{53 * int(name[1:]) % 89},0,0,0,1,{kinds[name]}"
        for name in names
    ]
    table, file = folder / "plate.csv", folder / "plate.yaml"
    table.write_text("\n".join(["name,x,y,z,nx,ny,nz,kind", *rows]) + "\n")
    result = CliRunner().invoke(app, ["import", "qif", str(table), "--output", str(file)])
    assert result.exit_code == 0, result.output
    if statics:
        file.write_text(file.read_text().replace("statics:\n", f"statics:\n  - {statics}\n"))
    return file


def read(file: Path) -> Problem:
    problem = load(file).problem
    assert problem is not None
    return problem


def names_of(visits: object) -> list[str]:
    return [each.name for each in visits]  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    return read(written(tmp_path_factory.mktemp("plate"), NAMES))


class Quiet(list[Problem]):
    """A problem in a list that a falsified law does not print."""

    def __repr__(self) -> str:
        return "plate"


@pytest.fixture(scope="module")
def shared(plate: Problem) -> Quiet:
    return Quiet([plate])


@pytest.fixture(scope="module")
def spare(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A plate whose first point the laser can take as well."""
    return read(written(tmp_path_factory.mktemp("spare"), NAMES, statics="needs(p1, profile)"))


def new(problem: Problem) -> SequencePlan:
    return SequencePlan(problem.domain.name, problem.name)


events = st.one_of(
    st.builds(lambda n: SequenceNews(done=(n,)), st.sampled_from(NAMES)),
    st.builds(lambda n: SequenceNews(bad={n: "dirty"}), st.sampled_from(NAMES)),
    st.builds(lambda n: SequenceNews(lost=(n,)), st.sampled_from(["us_probe", "slra"])),
    st.builds(lambda n: SequenceNews(restored=(n,)), st.sampled_from(["us_probe", "slra", *NAMES])),
)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(happening=st.lists(events, min_size=1, max_size=6))
def test_done_visits_stay_done_and_the_rest_is_a_permutation_of_what_remains(
    shared: list[Problem], happening: list[SequenceNews]
) -> None:
    (plate,) = shared
    plan = carry_on_sequence(new(plate), plate, limits=QUICK).plan
    for news in happening:
        try:
            found = carry_on_sequence(plan, plate, news, QUICK)
        except InvalidInput:
            continue  # what is left out cannot be done, what is done cannot be bad
        made = found.plan
        assert made.done[: len(plan.done)] == plan.done
        possible = {
            (name, tool)
            for tool, names in partition_after_loss(plate, made.lost).groups.items()
            for name in names
        }
        remaining = {
            each
            for each in possible
            if each[0] not in made.bad and each[0] not in names_of(made.done)
        }
        assert len(made.rest) == len(remaining)
        assert {(each.name, each.tool) for each in made.rest} == remaining
        _accounts_for_every_visit(plan, found)
        _costs_no_more_than_the_old_order(plan, found)
        plan = made


def _accounts_for_every_visit(old: SequencePlan, found: KeptSequenceProgress) -> None:
    finished = set(names_of(found.plan.done)) - set(names_of(old.done))
    groups = [
        found.kept,
        found.reordered,
        found.moved,
        found.dropped,
        finished & set(names_of(old.rest)),
    ]
    assert sorted(name for each in groups for name in each) == sorted(names_of(old.rest))
    staying = [name for name in names_of(found.plan.rest) if name in found.kept]
    assert staying == [name for name in names_of(old.rest) if name in found.kept]


def _costs_no_more_than_the_old_order(old: SequencePlan, found: KeptSequenceProgress) -> None:
    number = {visit.name: index for index, visit in enumerate(found.problem.visits)}
    start = [number[each.name] for each in found.plan.done[-1:] if each.name in number]
    left = {each.name for each in found.plan.rest} - {*found.added}
    order = (*start, *(number[name] for name in names_of(old.rest) if name in left))
    if not found.added:
        assert found.tour.cost <= cost_of(found.problem, order) if order else found.tour.cost == 0


def test_a_visit_done_stays_outdated_though_its_tool_is_lost(tmp_path: Path) -> None:
    store, file = str(tmp_path / "s.db"), written(tmp_path, NAMES[:6])
    first = carry_on(store, read(file), limits=QUICK).plan.rest[0]
    carry_on(store, read(file), SequenceNews(done=(first.name,), lost=(first.tool,)), QUICK)
    assert not carry_on(store, read(file), limits=QUICK).outdated
    moved = read(written(tmp_path, NAMES[:6], shift=1.0))
    assert carry_on(store, moved, limits=QUICK).outdated == (first.name,)


@pytest.mark.parametrize("tool", ["us_probe", "slra"])
@pytest.mark.parametrize("done", [0, 1, 5])
def test_losing_a_tool_moves_or_drops_exactly_its_visits(
    spare: Problem, tool: str, done: int
) -> None:
    plan = carry_on_sequence(new(spare), spare, limits=QUICK).plan
    plan = carry_on_sequence(
        plan, spare, SequenceNews(done=tuple(names_of(plan.rest[:done]))), QUICK
    ).plan
    found = carry_on_sequence(plan, spare, SequenceNews(lost=(tool,)), QUICK)
    assert {*found.moved, *found.dropped} == {each.name for each in plan.rest if each.tool == tool}
    assert found.plan.done == plan.done
    if tool == "us_probe" and "p1" in names_of(plan.rest):
        assert found.moved == {"p1": ("us_probe", "slra")}
        back = carry_on_sequence(found.plan, spare, SequenceNews(restored=(tool,)), QUICK)
        assert back.moved == {"p1": ("slra", "us_probe")}
        assert set(names_of(back.plan.rest)) == set(names_of(plan.rest))


def test_what_is_done_before_its_tool_is_lost_counts_as_done(plate: Problem) -> None:
    plan = carry_on_sequence(new(plate), plate, limits=QUICK).plan
    first = plan.rest[0]
    found = carry_on_sequence(
        plan, plate, SequenceNews(done=(first.name,), lost=(first.tool,)), QUICK
    )
    assert found.plan.done == (first,)
    assert first.name not in found.dropped


def test_without_its_arm_nothing_is_measured(plate: Problem) -> None:
    assert not partition_after_loss(plate, ["t3_746"]).groups
    assert partition_after_loss(plate, ["rack"]) == partition_after_loss(plate, [])


def test_visits_done_in_order_leave_the_sequence_as_it_stands(plate: Problem) -> None:
    first = carry_on_sequence(new(plate), plate, limits=QUICK)
    found = carry_on_sequence(
        first.plan, plate, SequenceNews(done=tuple(names_of(first.plan.rest[:4]))), QUICK
    )
    assert (found.way, found.plan.rest) == ("kept", first.plan.rest[4:])
    assert found.next == first.plan.rest[4]


def test_a_visit_done_out_of_turn_is_where_the_rest_begins_and_costs_no_more_than_the_old_order(
    plate: Problem,
) -> None:
    first = carry_on_sequence(new(plate), plate, limits=QUICK)
    turn = first.plan.rest[6].name
    found = carry_on_sequence(first.plan, plate, SequenceNews(done=(turn,)), QUICK)
    assert found.way == "resequenced"
    assert found.problem.visits[found.tour.order[0]].name == turn
    number = {visit.name: index for index, visit in enumerate(found.problem.visits)}
    old = tuple(number[each.name] for each in first.plan.rest if each.name != turn)
    assert found.tour.cost <= cost_of(found.problem, (number[turn], *old))
    assert found.tour.cost == cost_of(found.problem, found.tour.order)
    assert not tour_violations(found.problem, found.tour.order)


def test_points_added_removed_and_placed_elsewhere_are_noticed(tmp_path: Path) -> None:
    store = str(tmp_path / "s.db")
    first = carry_on(store, read(written(tmp_path, NAMES[:9])), limits=QUICK)
    gone, was = names_of(first.plan.rest)[3], first.plan.rest[0].name
    carry_on(store, read(written(tmp_path, NAMES[:9])), SequenceNews(done=(was,)), QUICK)
    left = [name for name in NAMES[:11] if name != gone]
    found = carry_on(store, read(written(tmp_path, left)), limits=QUICK)
    assert (set(found.added), dict(found.dropped)) == (
        {"p9", "p10"},
        {gone: "no longer in the problem"},
    )
    shifted = carry_on(store, read(written(tmp_path, left, shift=2.0)), limits=QUICK)
    assert (shifted.way, shifted.outdated) == ("resequenced", (was,))
    assert shifted.plan.rest[0].position != found.plan.rest[0].position


def test_what_the_problem_says_is_measured_becomes_done(tmp_path: Path) -> None:
    store, file = str(tmp_path / "s.db"), written(tmp_path, NAMES[:5])
    carry_on(store, read(file), limits=QUICK)
    file.write_text(file.read_text() + "initial:\n  - measured(slra, t3_746, meas(p3))\n")
    found = carry_on(store, read(file), limits=QUICK)
    assert names_of(found.plan.done) == ["p3"]
    assert "p3" not in names_of(found.plan.rest)


@pytest.mark.parametrize(
    ("news", "said"),
    [
        (SequenceNews(done=("p99",)), "unknown visit"),
        (SequenceNews(lost=("hammer",)), "unknown resource"),
        (SequenceNews(bad={"slra": "x"}), "unknown visit"),
    ],
)
def test_unknown_names_are_refused_and_change_nothing(
    plate: Problem, tmp_path: Path, news: SequenceNews, said: str
) -> None:
    store = str(tmp_path / "s.db")
    before = carry_on(store, plate, limits=QUICK).plan
    with pytest.raises(InvalidInput, match=said):
        carry_on(store, plate, news, QUICK)
    with Sequences(store) as sequences:
        kept = sequences.of(plate.domain.name, plate.name)
    assert kept is not None
    assert kept.rest == before.rest


def _work_off(store: str, file: str, mine: list[str]) -> None:
    problem = read(Path(file))
    for name in mine:
        carry_on(store, problem, SequenceNews(done=(name,)), QUICK)


def test_two_processes_at_once_lose_no_visit(tmp_path: Path) -> None:
    store, file = str(tmp_path / "s.db"), written(tmp_path, NAMES)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        [
            "cellwright.engine.pipelines.inspection.tool_tours",
            "cellwright.kb.store.inspection_store",
            "pytest",
        ]
    )
    shares = (NAMES[:6], NAMES[6:12])
    workers = [
        context.Process(target=_work_off, args=(store, str(file), share)) for share in shares
    ]
    for each in workers:
        each.start()
    for each in workers:
        each.join(100)
    assert [each.exitcode for each in workers] == [0, 0]
    found = carry_on(store, read(file), limits=QUICK)
    assert sorted(names_of(found.plan.done)) == sorted(NAMES[:12])
    assert sorted(names_of(found.plan.rest)) == sorted(NAMES[12:])


def run(*arguments: str) -> tuple[int, dict[str, object], str]:
    result = CliRunner().invoke(app, ["sequence", *arguments])
    data = (
        json.loads(result.stdout)["data"] if "json" in arguments and result.exit_code == 0 else {}
    )
    return result.exit_code, data, result.stdout


def test_visits_are_asked_for_one_by_one_until_none_is_left(tmp_path: Path) -> None:
    file, store = str(written(tmp_path, NAMES[:4])), str(tmp_path / "s.db")
    _, whole, _ = run(file, "--store", store, "--format", "json")
    seen = []
    while (answer := run(file, "--store", store, "--next", "--format", "json")[1])[
        "next"
    ] is not None:
        seen.append(answer["next"]["visit"])  # type: ignore[index]
        assert run(file, "--store", store, "--done", str(seen[-1]))[0] == 0
    assert seen == whole["visits"]
    assert "nothing is left" in run(file, "--store", store, "--next")[2]
    assert run(file, "--store", store, "--anew", "--format", "json")[1]["visits"] == whole["visits"]


def test_reasons_may_hold_commas_and_several_visits_may_share_one(tmp_path: Path) -> None:
    file, store = str(written(tmp_path, NAMES[:4])), str(tmp_path / "s.db")
    _, data, _ = run(file, "--store", store, "--bad", "p1, p2=rust, and dirt", "--format", "json")
    assert data["bad"] == {"p1": "rust, and dirt", "p2": "rust, and dirt"}
    assert sorted(data["visits"]) == ["p0", "p3"]  # type: ignore[call-overload]


@pytest.mark.parametrize("wrong", [["--next"], ["--store", "s.db", "--closed"], ["--done", "p1"]])
def test_options_that_do_not_go_together_are_refused(tmp_path: Path, wrong: list[str]) -> None:
    assert run(str(written(tmp_path, NAMES[:2])), *wrong)[0] == 2


WINDOWS = "window(p2, 0, 30)\n  - window(p5, 400, 900)\n  - before(p9, p1)\n  - lasts(p7, 20)"


def test_a_kept_sequence_keeps_windows_and_precedence_to_its_end(tmp_path: Path) -> None:
    store, problem = str(tmp_path / "cell.db"), read(written(tmp_path, NAMES, statics=WINDOWS))
    made = carry_on(store, problem, limits=QUICK)
    begins = dict(
        zip(names_of(made.plan.rest), times_of(made.problem, made.tour.order), strict=True)
    )
    order = names_of(made.plan.rest)
    assert order.index("p9") < order.index("p1")
    assert begins["p2"][1] <= 30
    assert 400 <= begins["p5"][1] <= 900
    done = order[: order.index("p5")]
    assert done
    for each in done:
        found = carry_on(store, problem, SequenceNews(done=(each,)), QUICK)
        assert found.way == "kept"
        assert tour_violations(found.problem, found.tour.order) == []
    over = begins[done[-1]][1]
    windows = {each.name: each.window for each in found.problem.visits}
    assert windows["p5"] == (max(0, 400 - over), 900 - over)
    assert windows[done[-1]] is None


def test_windows_that_the_rest_cannot_keep_are_told(tmp_path: Path) -> None:
    store, problem = str(tmp_path / "cell.db"), read(written(tmp_path, NAMES))
    carry_on(store, problem, SequenceNews(done=("p0",)), QUICK)
    narrow = read(written(tmp_path, NAMES, statics="window(p2, 0, 0)\n  - window(p4, 0, 0)"))
    found = carry_on(store, narrow, limits=QUICK)
    assert found.unkept
    assert carry_on(store, narrow, limits=QUICK).way == "kept"
