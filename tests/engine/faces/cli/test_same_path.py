"""A path has the same bytes whatever the processor can do."""

import os
import subprocess
import sys

import pytest

from tests.places import TOP

COMMAND = [
    sys.executable,
    "-m",
    "engine.faces.cli",
    "motion",
    "plan",
    "bulkhead",
    "--from",
    "home",
    "--to",
    "meas(m2)",
]
OLDER = {  # how libraries for matrices and mathematics take a processor for an older one
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX,-FMA,-AVX512F",
}


@pytest.mark.slow
def test_a_path_is_the_same_on_an_older_processor() -> None:
    answers = [
        subprocess.run(
            [*COMMAND, "--format", "json"],
            env={**os.environ, **more},
            cwd=TOP,
            capture_output=True,
            check=True,
        ).stdout
        for more in ({}, OLDER)
    ]
    assert answers[0] == answers[1]
