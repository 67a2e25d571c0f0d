"""A pytest plugin: it tests every `domain.yaml` that pytest finds beside a `golden` folder.

There is one test per problem; a problem file with a line `# slow` is marked slow. `--update-plans`
accepts the new answers; it is refused in continuous integration.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SLOW_LINE = "# slow"  # in the file of a problem that takes long


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option `--update-plans`."""
    group = parser.getgroup("cellwright")
    group.addoption(
        "--update-plans", action="store_true", help="accept changed plans as golden files"
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """A domain with golden plans is a collection of tests."""
    if file_path.name == "domain.yaml" and (file_path.parent / "golden").is_dir():
        collector: pytest.Collector = GoldenDomain.from_parent(parent, path=file_path)
        return collector
    return None


class GoldenDomain(pytest.File):
    """The problems of one domain."""

    def collect(self) -> Iterator[pytest.Item]:
        """One item per problem file."""
        from cellwright.kb.targets import problem_files  # only where there is such a folder

        for file in problem_files(self.path):
            item = GoldenPlan.from_parent(self, name=file.stem, problem_file=file)
            if SLOW_LINE in file.read_text("utf-8").splitlines():
                item.add_marker("slow")
            yield item


class GoldenDifference(Exception):
    """An answer is not the accepted one; the text says how."""


class GoldenPlan(pytest.Item):
    """One problem planned again."""

    def __init__(self, *, problem_file: Path, **rest: Any) -> None:
        super().__init__(**rest)
        self.problem_file = problem_file

    def runtest(self) -> None:
        """Compare the answer with the golden file, or accept it."""
        from cellwright.engine.authoring.testing.golden_files import (
            GOLDEN_FOLDER,
            accept_answer,
            compare_with_golden,
        )

        golden = self.problem_file.parent.parent / GOLDEN_FOLDER / f"{self.problem_file.stem}.json"
        comparison = compare_with_golden(self.problem_file, golden)
        if comparison.verdict == "same":
            return
        if self.config.getoption("--update-plans") and not os.environ.get("CI"):
            accept_answer(comparison)
        else:
            raise GoldenDifference("\n".join([", ".join(comparison.meaning), *comparison.diff]))

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        """Only the difference, without a traceback."""
        if isinstance(excinfo.value, GoldenDifference):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """The file of the problem."""
        return self.problem_file, 0, f"golden plan of {self.problem_file.stem}"
