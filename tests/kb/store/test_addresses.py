"""Names of libraries that cannot be used are refused with one diagnostic."""

import subprocess
import sys
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.database import store_url

ODD = [
    "", " ", "sqlite://", "sqlite:///", "sqlite:///a.db?mode=ro", "sqlite:///%00", "a\nb.db", "a\x00.db", "://",
    "mysql://a/b", "http://[::1", "postgresql://", "postgresql://host", "postgresql://u:p@h:abc/d",
    "postgresql://u@h:99999/d",
]  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_an_odd_address_is_refused(name: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        store_url(name)
    assert [each.code for each in refused.value.diagnostics] == ["K416"]


@pytest.mark.parametrize(
    "name", ["library.db", "~nobody_of_this_name/library.db", "sqlite:///library.db"]
)
def test_files_are_taken(name: str) -> None:
    assert store_url(name).drivername == "sqlite"


def test_a_connection_that_cannot_be_closed_prints_nothing(
    capfd: pytest.CaptureFixture[str],
) -> None:
    program = (
        "import logging; from cellwright.kb.store.database import connect_engine; "
        "connect_engine('postgresql://me@nowhere/db');"
        "logging.getLogger('sqlalchemy.pool.impl.QueuePool').error('Exception terminating "
        "connection')"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=Path(__file__).parents[3])
    assert capfd.readouterr() == ("", "")
