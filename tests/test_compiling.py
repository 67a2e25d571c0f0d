"""What was compiled once is taken from the cache, and never for other sources, types or flags."""

from pathlib import Path

import pytest

pytest.importorskip("setuptools")  # it is there where something is built

from setuptools import Extension

import compiling


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one kernel and its types, and a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CELLWRIGHT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(compiling, "compiler", lambda: "system")
    (tmp_path / "cellwright" / "engine").mkdir(parents=True)
    (tmp_path / "cellwright" / "engine" / "loop.py").write_text("def loop(): pass\n")
    (tmp_path / "cellwright" / "engine" / "loop.pxd").write_text("cpdef void loop()\n")
    (tmp_path / "cellwright" / "engine" / "other.pxd").write_text("cdef struct Other:\n    int n\n")
    return tmp_path / "cellwright" / "engine"


def kept() -> Path:
    folder = compiling.cache()
    assert folder is not None
    return compiling._kept(
        folder, [Extension("cellwright.engine.loop", ["cellwright/engine/loop.py"])]
    )["cellwright.engine.loop"]


def test_the_same_source_has_the_same_place(sources: Path) -> None:
    assert kept() == kept()
    assert kept().parent == sources.parents[1] / "cache" / "kernels"


@pytest.mark.parametrize("changed", ["loop.py", "loop.pxd", "other.pxd", "new.h"])
def test_another_source_or_type_has_another_place(sources: Path, changed: str) -> None:
    before = kept()
    with (sources / changed).open("a") as file:
        file.write("# changed\n")
    assert kept() != before


@pytest.mark.parametrize("name", ["CFLAGS", "LDFLAGS"])
@pytest.mark.usefixtures("sources")
def test_other_flags_have_another_place(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = kept()
    monkeypatch.setenv(name, "-O1")
    assert kept() != before


def test_what_is_kept_comes_back_whole(sources: Path) -> None:
    made, again = sources / "loop.so", sources / "deep" / "loop.so"
    made.write_bytes(b"compiled")
    assert not compiling._restored(kept(), again)
    compiling._keep(made, kept())
    assert compiling._restored(kept(), again)
    assert again.read_bytes() == b"compiled"
    assert [each.name for each in kept().parent.iterdir()] == [kept().name]


def test_only_the_newest_are_kept(sources: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "MOST", 3)
    made = sources / "loop.so"
    made.write_bytes(b"compiled")
    for number in range(6):
        compiling._keep(made, kept().with_name(f"{number}.so"))
    assert len(list(kept().parent.iterdir())) == 3


def test_there_need_be_no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CELLWRIGHT_CACHE", "none")
    assert compiling.cache() is None
    (tmp_path / "file").touch()
    monkeypatch.setenv("CELLWRIGHT_CACHE", str(tmp_path / "file"))
    assert compiling.cache() is None
