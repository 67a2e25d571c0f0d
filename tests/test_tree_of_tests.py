"""The tree of tests mirrors the product, and no two test files share a name."""

from collections import Counter

from tests.places import TOP

TESTS = TOP / "tests"
CELLS = {"themse"}  # tests of one bundled cell, across all rooms


def test_each_folder_of_tests_has_its_folder_in_the_product() -> None:
    for part in ("kb", "engine", "cellwright"):
        folders = {file.parent.relative_to(TESTS) for file in (TESTS / part).rglob("test_*.py")}
        assert folders
        missing = {folder for folder in folders if not (TOP / folder).is_dir()}
        assert {folder for folder in missing if folder.name not in CELLS} == set()


def test_a_room_has_its_tests_in_its_folder_and_none_beside_the_rooms() -> None:
    for floor in ("pipelines", "stages", "faces"):
        assert list((TESTS / "engine" / floor).glob("test_*.py")) == []


def test_no_two_test_files_share_a_name() -> None:
    # pytest reads `conftest.py` in each folder
    names = Counter(file.name for file in TESTS.rglob("*.py") if file.name != "conftest.py")
    assert [name for name, count in names.items() if count > 1] == []


def test_the_files_that_a_mutation_run_names_are_there() -> None:
    text = (TOP / "benchmarks" / "mutation_modules.py").read_text("utf-8")
    names: dict[str, dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {}
    exec(compile(text, "mutation_modules", "exec"), names)
    for patterns, tests in names["MODULES"].values():
        assert all(list(TOP.glob(pattern)) for pattern in patterns)
        assert [test for test in tests if not (TOP / test).is_file()] == []
