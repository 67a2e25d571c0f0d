"""Kernels are compiled together or not at all, and who runs them as plain Python is told."""

import json
import re
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.output.answer_output import UNCOMPILED, is_uncompiled
from cellwright.engine.kernels import bits
from tests.places import TOP

KERNELS = sorted(TOP.glob("engine/**/*.pxd"))


def test_kernels_are_compiled_together_or_not_at_all() -> None:
    compiled = {
        any(file.with_suffix(end).is_file() for end in EXTENSION_SUFFIXES) for file in KERNELS
    }
    assert len(compiled) == 1, "python setup.py build_ext --inplace"


@pytest.mark.parametrize("types", KERNELS, ids=lambda types: types.stem)
def test_each_option_of_a_kernel_stands_on_a_line_that_the_compiler_reads(types: Path) -> None:
    """Cython takes an option only from a comment of its own that begins with `cython:`."""
    comments = types.with_suffix(".py").read_text().partition('"""')[0].splitlines()
    options = [line for line in comments if re.search(r"\w=(True|False|\d)", line)]
    assert options
    assert all(re.fullmatch(r"# cython: \w+=\w+(, \w+=\w+)*", line) for line in options)


def test_plain_python_in_place_of_a_kernel_is_told_once_and_not_in_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bits, "__file__", str(TOP / "engine" / "kernels" / "bits.py"))
    result = CliRunner().invoke(app, ["plan", "bulkhead/one_point", "--format", "json"])
    assert json.loads(result.stdout)["status"] == "optimal"
    assert result.stderr == UNCOMPILED


def test_modules_without_types_are_no_kernels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("cellwright.engine.")]:
        monkeypatch.delitem(sys.modules, name)
    plain = type(sys)("cellwright.engine.plain")
    plain.__file__ = str(tmp_path / "plain.py")
    monkeypatch.setitem(sys.modules, "cellwright.engine.plain", plain)
    assert not is_uncompiled()
    (tmp_path / "plain.pxd").touch()
    assert is_uncompiled()
