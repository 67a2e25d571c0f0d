"""S-LAB tables and job-shop files are read as they are, and what is wrong in them is told with
its place.
"""

from pathlib import Path

import pytest

from cellwright.engine.formats.interop.shop_files import is_slab, read_jobshop, read_slab
from cellwright.engine.model.shop_scheduling import (
    Resource,
    StageMoment,
    StageWindow,
    ValidSchedule,
)
from cellwright.engine.stages.scheduling import schedule_shop
from cellwright.kb.diagnostics import InvalidInput

TABLES = {
    "machines": "No\tType\tName\n1\t1\tshaker A\n2\t1\tshaker B\n3\t2\treader\n",
    "operations": "Job\tOp\tMachine\tTime\tNote\n1\t1\t1\t5\tshake\n1\t2\t2\t3\tread\n2\t1\t1\t5\tshake\n2\t2\t2\t3\tread\n",
    "dependency": "Job\tA\tB\n1\t1\t2\n2\t1\t2\n\t\t\n",
    "tcmb": "Job\tA\tPoint\tB\tPoint\tTime\n1\t1\tend\t2\tstart\t1\n2\t1\tend\t2\tstart\t1\n\t\t\t\t\t",
}


def written(folder: Path, **changed: str) -> Path:
    for name, text in {**TABLES, **changed}.items():
        (folder / f"{name}.tsv").write_bytes(text.replace("\n", "\r\n").encode())
    return folder


def found_in(folder: Path) -> list[str]:
    with pytest.raises(InvalidInput) as refused:
        read_slab(folder)
    return [
        f"{each.code} {Path(each.where.path).name}:{each.where.line} {each.message}"
        for each in refused.value.diagnostics
    ]


def test_tables_become_a_shop(tmp_path: Path) -> None:
    shop = read_slab(written(tmp_path))
    assert is_slab(tmp_path)
    assert shop.resources == (
        Resource("type 1", 2, units=("shaker A", "shaker B")),
        Resource("type 2", 1, units=("reader",)),
    )
    assert [job.name for job in shop.jobs] == ["1", "2"]
    assert shop.stages["2.2"].duration == 3
    assert StageWindow(StageMoment("1.1", 5), StageMoment("1.2")) in shop.windows
    assert StageWindow(StageMoment("1.1", 5), StageMoment("1.2"), -1, 1) in shop.windows


def test_boundaries_keep_two_samples_from_starting_together(tmp_path: Path) -> None:
    found = schedule_shop(read_slab(written(tmp_path)))
    assert isinstance(found, ValidSchedule)
    assert found.schedule.makespan == 11
    starts = found.schedule.starts
    assert abs(starts["1.1"] - starts["2.1"]) >= 2
    assert found.schedule.proved


def test_every_mistake_is_told_with_its_line(tmp_path: Path) -> None:
    written(
        tmp_path,
        operations="Job\tOp\tMachine\tTime\n1\t1\t9\t5\n1\t1\t1\tsoon\n1\t2\n",
        tcmb="Job\tA\tPoint\tB\tPoint\tTime\n1\t1\tfinish\t7\tstart\t1\n",
    )
    assert sorted(found_in(tmp_path)) == [
        "K101 dependency.tsv:2 there is no operation 1.2",
        "K101 dependency.tsv:3 there is no operation 2.1",
        "K101 dependency.tsv:3 there is no operation 2.2",
        "K101 operations.tsv:2 there is no machine of type 9",
        "K101 tcmb.tsv:2 there is no operation 1.7",
        "K103 operations.tsv:3 'soon' is not a whole number, so it is no time",
        "K104 operations.tsv:3 operation 1 of job 1 is listed twice",
        "K806 operations.tsv:4 4 columns are needed, but this line has 2",
        "K806 tcmb.tsv:2 'finish' is not a point of an operation",
    ]


def test_a_missing_table_is_told(tmp_path: Path) -> None:
    written(tmp_path)
    (tmp_path / "tcmb.tsv").unlink()
    assert found_in(tmp_path)[0].startswith("K001 tcmb.tsv:0 cannot be read")


TEXT = "a comment\n2 2\n0 3 1 2\n1 2 0 1\n"
JSON = (
    '{"small": {"duration_matrix": [[3, 2], [2, 1]], "machines_matrix": [[0, 1], [1, 0]]}, '
    '"none": {}}'
)


def test_both_notations_of_job_shops_say_the_same(tmp_path: Path) -> None:
    text, data = tmp_path / "small.txt", tmp_path / "all.json"
    text.write_text(TEXT)
    data.write_text(JSON)
    shop = read_jobshop(text)
    assert shop == read_jobshop(data, "small")
    found = schedule_shop(shop)
    assert isinstance(found, ValidSchedule)
    assert found.schedule.makespan == 5


@pytest.mark.parametrize(
    ("name", "content", "instance", "code", "said"),
    [
        ("a.json", JSON, "", "K409", "several instances; name one"),
        ("a.json", JSON, "smal", "K406", "no instance 'smal'"),
        ("a.json", JSON, "none", "K806", "none needs duration_matrix and machines_matrix"),
        ("a.json", JSON.replace("[2, 1]]", "[2]]"), "small", "K806", "differ in shape"),
        ("a.json", JSON.replace("[[3", "[[true"), "small", "K806", "in whole numbers"),
        ("a.json", "{", "", "K806", "not JSON"),
        ("a.txt", "words\n", "", "K806", "no line with the numbers"),
        ("a.txt", TEXT.replace("2 2", "3 2", 1), "", "K806", "3 jobs are announced, but 2 lines"),
        (
            "a.txt",
            TEXT.replace("1 2 0 1", "1 2 5 1"),
            "",
            "K806",
            "pairs of a machine number below 2",
        ),
    ],
)
def test_what_is_no_job_shop_is_refused(
    tmp_path: Path, name: str, content: str, instance: str, code: str, said: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInput) as refused:
        read_jobshop(tmp_path / name, instance)
    (found,) = refused.value.diagnostics
    assert found.code == code
    assert said in found.message
