"""Paths have the same bytes whatever the processor can do."""

import os
import subprocess
import sys

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__

from tests.places import TOP

MOTIONS = """
import typer.testing, cellwright.engine.faces.cli

for cell, to, *more in (
    ("bulkhead", "meas(m2)"),
    ("bulkhead", "meas(m5)", "--refine", "5000"),
    ("bulkhead", "meas(m2)", "--strategy", "visibility"),
    ("bulkhead", "meas(m2)", "--strategy", "reduced", "--rest"),
    ("themse", "slot(drawer, 1)"),
    ("themse", "slot(furnace, 1)", "--margin", "0.002"),
):
    words = ["motion", "plan", cell, "--from", "home", "--to", to, *more, "--format", "json"]
    answer = typer.testing.CliRunner().invoke(cellwright.engine.faces.cli.app, words)
    assert answer.exit_code == 0, answer.output
    print(answer.stdout)
"""
OLDER = {  # how libraries for matrices, mathematics and arrays take a processor for an older one
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX,-FMA,-AVX512F",
    "NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__),
    "PYTHONWARNINGS": "ignore",  # of features that this processor does not have anyway
}


@pytest.mark.slow
def test_paths_are_the_same_on_an_older_processor() -> None:
    answers = [
        subprocess.run(
            [sys.executable, "-c", MOTIONS],
            env={**os.environ, **more},
            cwd=TOP,
            capture_output=True,
            check=True,
        ).stdout
        for more in ({}, OLDER)
    ]
    assert answers[0] == answers[1]
