"""What each test costs, in seconds of the processor: a run of many tests ends with the
costliest ones.
"""

import resource
from collections.abc import Generator

import pytest

COSTLIEST = 10
WORTH_TELLING_S = 30.0  # a run that costs less ends without the list
SPENT = "processor_s"
BEGUN = pytest.StashKey[float]()


def spent_s() -> float:
    """Seconds of the processor that this process and the children that it waited for have used."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


class Costs:
    """Workers put the cost of a test on its last report; who runs them adds up and tells."""

    def __init__(self) -> None:
        self.by_test: dict[str, float] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """A test begins."""
        item.stash[BEGUN] = spent_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """A part of a test has ended; with its last part the whole of it has."""
        report = yield
        if call.when == "teardown" and BEGUN in item.stash:
            report.user_properties.append((SPENT, spent_s() - item.stash[BEGUN]))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A report has arrived."""
        for name, value in report.user_properties:
            if report.when == "teardown" and name == SPENT and isinstance(value, float):
                self.by_test[report.nodeid] = value

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """The run is over."""
        whole = sum(self.by_test.values())
        if whole < WORTH_TELLING_S:
            return
        terminalreporter.section(
            f"costliest of {len(self.by_test)} tests, {whole:.0f} s of the processor"
        )
        for name, each in sorted(self.by_test.items(), key=lambda pair: -pair[1])[:COSTLIEST]:
            terminalreporter.write_line(f"{each:6.1f} s  {name}")
