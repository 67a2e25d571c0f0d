"""Of all who want to drive a run, one does: the others are refused, or wait until it is gone."""

import itertools
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from benchmarks.postgres import emptied
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal, JournalFailure, JournalLine, LeaseLost
from cellwright.kb.store.network_drives import network_drive
from cellwright.kb.store.run_lease import LeasePace, ProcessIdentity, RunLease, is_gone, taken_lease

QUICK = LeasePace(beat_s=0.02, lapse_s=0.2, look_s=0.01)
LEASE = sys.modules[RunLease.__module__]


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes count as those of machines about which nothing is known here."""
    numbers = itertools.count(1)
    monkeypatch.setattr(
        LEASE, "own_identity", lambda: ProcessIdentity(f"host {next(numbers)}", 1, "1")
    )


def taken(target: str, pace: LeasePace = QUICK) -> RunLease:
    return taken_lease(target, "r", pace=pace)


def test_the_second_is_refused_as_soon_as_a_beat_of_the_first_is_seen(target: str) -> None:
    with taken(target) as first, pytest.raises(InvalidInput, match="is driven by") as told:
        taken(target)
    assert told.value.diagnostics[0].code == "K421"
    assert first.fence
    with taken(target) as second:
        assert second.fence > first.fence


@pytest.mark.usefixtures("elsewhere")
def test_a_host_that_stands_still_is_replaced_and_knows_it(target: str) -> None:
    first = taken(target)
    first.stop_beat()
    with taken(target) as second:
        assert second.fence > first.fence
        second.require()
        first._confirmed = float("-inf")
        with pytest.raises(LeaseLost):
            first.require()
        first.close()
        second.require()
        stored = second._look()
        assert stored is not None
        assert not stored.free


def test_of_a_process_of_this_machine_that_has_ended_nobody_waits(
    target: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    identity = LEASE.own_identity()
    identity = identity._replace(process=ended.pid, started=LEASE._process_start(ended.pid))
    assert not is_gone(identity)
    with monkeypatch.context() as context:
        context.setattr(LEASE, "own_identity", lambda: identity)
        first = taken(target, LeasePace(lapse_s=1e6))
    first.stop_beat()
    ended.communicate()
    assert is_gone(identity)
    taken(target).close()
    first.close()


@pytest.mark.usefixtures("elsewhere")
def test_what_the_former_driver_appends_is_refused(target: str) -> None:
    with Journal(target) as journal:
        journal.begin("r", "2026-01-01", {})
        first = taken(target)
        journal.append("r", [JournalLine(1, 0, "run")], first.fence)
        first.stop_beat()
        with taken(target) as second:
            with pytest.raises(LeaseLost):
                journal.append("r", [JournalLine(2, 0, "command")], first.fence)
            assert journal.last("r") == 1
            journal.append("r", [JournalLine(2, 0, "command")], second.fence)
            assert journal.last("r") == 2
        first.close()


@pytest.mark.slow
@pytest.mark.usefixtures("elsewhere")
def test_a_host_that_stands_still_in_a_transaction_holds_nobody_up(postgres: str) -> None:
    """The server ends the transaction, and with it the lock of the row."""
    emptied(postgres)
    first = taken(postgres)
    first.stop_beat()
    with first._engine.connect() as connection:
        connection.execute(text("UPDATE run_leases SET beat = beat + 1"))
        with taken(postgres) as second:
            assert second.fence > first.fence
        connection.invalidate()
    first.close()


def test_a_database_that_is_gone_is_no_reason_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    lease = RunLease(str(tmp_path / "j.db"), "r", LeasePace(beat_s=1e6), lambda: now[0])
    lease.take()

    def unreachable() -> bool:
        raise LEASE.store_refusal("j.db", "the server is gone")

    monkeypatch.setattr(lease, "_renewed", unreachable)
    now[0] = 11.0
    lease.require()
    now[0] = 12.1
    with pytest.raises(JournalFailure, match="the server is gone"):
        lease.require()
    assert not lease.is_lost
    lease.close()


class Host:
    """A host whose beats, looks and pauses a test decides."""

    def __init__(self, store: str, number: int, now: list[float]) -> None:
        self.lease = RunLease(store, "r", LeasePace(lapse_s=10.0), lambda: now[0])
        self.number, self.now = number, now
        self.seen: tuple[object, float] | None = None
        self.drives = False

    def look(self) -> None:
        """Look at the lease as one who waits does, and take it if its beat stood still."""
        stored = self.lease._look()
        if self.seen is None or self.seen[0] != stored:
            self.seen = stored, self.now[0]
        if not self.drives and self.lease._try_to_take(stored, self.seen[1]):
            self.drives = True

    def believes(self) -> bool:
        """Whether it would send now."""
        try:
            self.lease.require()
        except LeaseLost:
            self.drives = False
        return self.drives


moves = st.lists(
    st.tuples(
        st.sampled_from(["pass", "look", "look", "beat", "send", "jump"]),
        st.integers(0, 2),
        st.floats(0, 12),
    ),
    max_size=40,
)


@given(script=moves)
@settings(max_examples=60)
def test_never_do_two_send_whatever_stands_still_and_whatever_the_time_of_day_is(
    script: list[tuple[str, int, float]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    now, day, fences = [0.0], [1e9], list[int]()
    store = str(tmp_path_factory.mktemp("law") / "j.db")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LEASE, "own_identity", lambda: ProcessIdentity("", 1, "1"))
        patch.setattr(time, "time", lambda: day[0])
        hosts = [Host(store, number, now) for number in range(3)]
        for move, number, amount in script:
            host = hosts[number]
            match move:
                case "pass":
                    now[0] += amount
                case "jump":
                    day[0] += (amount - 6) * 1e6
                case "look":
                    drove = host.drives
                    host.look()
                    if host.drives and not drove:
                        fences.append(host.lease.fence)
                case "beat" if host.drives:
                    host.lease._renewed()
                case _:
                    # who sends must be the one who took the lease last
                    assert not host.believes() or host.lease.fence == fences[-1]
        assert fences == sorted(set(fences))
        for host in hosts:
            host.lease.close()


@pytest.mark.parametrize(
    ("mounts", "kind"),
    [
        ("/dev/sda1 / ext4 rw 0 0", ""),
        ("/dev/sda1 / ext4 rw 0 0\nhost:/runs /srv/runs nfs4 rw 0 0", "nfs4"),
        ("/dev/sda1 / ext4 rw 0 0\nhost:/runs /srv/run nfs4 rw 0 0", ""),
        ("host:/ / nfs rw 0 0\n/dev/sda1 /srv/runs ext4 rw 0 0", ""),
        ("/dev/sda1 / ext4 rw 0 0\n//host/share /srv cifs rw 0 0", "cifs"),
        (
            "x / ext4 rw 0 0\nx /srv/runs ext4 rw 0 0\ny:/z /srv/runs fuse.sshfs rw 0 0",
            "fuse.sshfs",
        ),
        ("", ""),
    ],
)
def test_a_file_is_on_the_drive_that_is_mounted_last_and_nearest(mounts: str, kind: str) -> None:
    assert network_drive(Path("/srv/runs/j.db"), mounts) == kind


def test_a_mount_may_have_a_space_in_its_name() -> None:
    mounts = "x / ext4 rw 0 0\nhost:/a /srv/all\\040runs nfs rw 0 0"
    assert network_drive(Path("/srv/all runs/j.db"), mounts) == "nfs"


def test_a_run_is_not_driven_from_a_file_on_a_network_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LEASE, "network_drive", lambda _: "nfs4")
    with pytest.raises(InvalidInput, match="network drive"):
        RunLease(str(tmp_path / "j.db"), "r")
