"""What is counted about sub-sequences adds up, whoever else counts, and goes with the MACROP."""

from multiprocessing.context import BaseContext

from macrops import macrop

from cellwright.kb.store import Library, Record
from cellwright.kb.store import table_schema as tables
from cellwright.kb.store.database import connect_engine, open_transaction
from cellwright.kb.store.usage_counts import RARELY, Utility

ONE = Utility(1, 1, 1, 10, 4)


def filled(library: Library) -> None:
    library.add([Record(macrop(name), f"{name}/0") for name in ("go", "stay")])
    library.add([Record(macrop("go", "themse"), "go/0")])


def test_figures_add_up_and_are_told_by_domain(target: str) -> None:
    with Library(target) as library:
        filled(library)
        library.note_utilities({(1, "forward"): ONE, (1, "backward"): ONE, (3, "forward"): ONE})
        library.note_utilities({(1, "forward"): ONE})
        assert library.utilities("bulkhead") == {(1, "backward"): ONE, (1, "forward"): ONE + ONE}
        assert library.utilities("themse") == {(3, "forward"): ONE}


def test_figures_go_with_the_macrop_and_none_are_kept_for_one_that_is_gone(target: str) -> None:
    with Library(target) as library:
        filled(library)
        library.note_utilities({(2, "forward"): ONE})
        library.forget([2])
        library.note_utilities({(2, "forward"): ONE, (1, "forward"): ONE})
        assert library.utilities() == {(1, "forward"): ONE}


def _count(target: str, times: int) -> None:
    with Library(target) as library:
        for _ in range(times):
            library.note_utilities({(2, "forward"): ONE, (1, "forward"): ONE})


def test_concurrent_writers_lose_no_count(target: str, processes: BaseContext) -> None:
    with Library(target) as library:
        filled(library)
        writers = [processes.Process(target=_count, args=(target, 10)) for _ in range(3)]
        for each in writers:
            each.start()
        for each in writers:
            each.join(60)
        assert [each.exitcode for each in writers] == [0, 0, 0]
        assert library.utilities() == dict.fromkeys(
            [(1, "forward"), (2, "forward")], Utility(30, 30, 30, 300, 120)
        )


def test_a_library_without_utilities_is_brought_up_to_date(target: str) -> None:
    with Library(target) as library:
        filled(library)
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        for table in (tables.utility, tables.outlines, tables.shared):
            table.drop(connection)
        tables.dependencies.create(connection)
        connection.execute(tables.versions.update().values(version=4))
    engine.dispose()
    with Library(target) as library:
        library.note_utilities({(1, "forward"): ONE})
        assert library.figures().schema == tables.CURRENT_SCHEMA
        assert len(library.all()) == 3


def test_what_spared_no_work_or_is_offered_in_vain_does_not_pay() -> None:
    assert Utility(trials=1, without=100, beside=80).pays
    assert not Utility(trials=1, without=100, beside=86).pays
    assert not Utility().pays
    assert not Utility(RARELY, 1, 1, 100, 10).pays
    assert Utility(RARELY, 2, 1, 100, 10).pays
