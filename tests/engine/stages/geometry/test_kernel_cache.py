"""Cached kernels are forgotten when any source that they may be made from has changed."""

from pathlib import Path

import pytest

from engine.kernels.geometry import forget_stale


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    kernels = tmp_path / "kernels"
    (kernels / "__pycache__").mkdir(parents=True)
    (kernels / "layout.py").write_text("A = 1\n")
    (kernels / "gjk.py").write_text("B = 1\n")
    forget_stale(kernels)
    (kernels / "__pycache__" / "gjk.f-1.py311.nbi").write_text("index")
    (kernels / "__pycache__" / "gjk.f-1.py311.1.nbc").write_text("code")
    return kernels


def cached(folder: Path) -> int:
    return len(list((folder / "__pycache__").glob("*.nb?")))


def test_nothing_is_forgotten_while_nothing_has_changed(folder: Path) -> None:
    assert not forget_stale(folder)
    assert cached(folder) == 2


@pytest.mark.parametrize("changed", ["gjk.py", "layout.py", "new.py"])
def test_a_changed_source_makes_all_be_compiled_again(changed: str, folder: Path) -> None:
    (folder / changed).write_text("C = 2\n")
    assert forget_stale(folder)
    assert cached(folder) == 0
    assert not forget_stale(folder)
