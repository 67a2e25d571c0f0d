"""Texts that people read, compared whole with what was accepted."""

import os
from pathlib import Path

import pytest


def compare_with_golden(file: Path, text: str, update: bool) -> None:
    """Compare, or accept; a text that was never accepted is a difference."""
    if update:
        if os.environ.get("CI"):
            pytest.fail(f"golden files are not rewritten in continuous integration: {file.name}")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
    assert file.is_file(), f"no golden file {file}; --update-golden would write:\n{text}"
    assert text == file.read_text("utf-8")
