"""Leases of runs: of all processes and hosts that share a database, one drives a run.

Whoever drives a run holds its lease: a row with a number of its own, the fence, which is greater
than all before it. The holder counts a beat up all the time, and with every record that it writes.
Whoever wants the lease looks at the beat: if it stands still for as long as the row says, measured
on the own clock that never jumps, the holder counts as gone, and the next one takes a greater
fence. No time of day is compared with another one, so clocks may be wrong and may jump. A holder
that could not count for most of that time does not believe in its lease any more.

These are the leases of Gray and Cheriton (1989), with the fencing numbers of Chubby (Burrows 2006).
"""

import contextlib
import getpass
import os
import platform
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Connection,
    Integer,
    MetaData,
    String,
    Table,
    insert,
    select,
    update,
)
from sqlalchemy.exc import IntegrityError

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.store.database import (
    MIGRATION,
    Database,
    lock_key,
    open_transaction,
    store_refusal,
)
from cellwright.kb.store.journal import JournalFailure, LeaseLost
from cellwright.kb.store.network_drives import network_drive

metadata = MetaData()
leases = Table(
    "run_leases",
    metadata,
    Column("run", String, primary_key=True),
    Column("fence", BigInteger, nullable=False),
    Column("beat", BigInteger, nullable=False),
    Column("lapse_ms", Integer, nullable=False),
    Column("free", Boolean, nullable=False),
    Column("holder", String, nullable=False),  # ACCOUNT@HOST
    Column("machine", String, nullable=False),  # this start of this system; empty: not known
    Column("process", Integer, nullable=False),
    Column("started", String, nullable=False),  # when the process was, as the system counts
)
BELIEVED_SHARE = 0.8  # of the lapse, in which a holder believes in its lease without a beat


@dataclass(frozen=True, slots=True)
class LeasePace:
    """How often a holder counts, after how long without a beat it counts as gone, and how often a
    process that waits looks. Seconds.
    """

    beat_s: float = 2.0
    lapse_s: float = 15.0
    look_s: float = 0.2


class ProcessIdentity(NamedTuple):
    """A process: the start of its system with its space of process numbers, its number, and when
    it was started. `machine` is empty where the system does not tell it.
    """

    machine: str
    process: int
    started: str


class StoredLease(NamedTuple):
    """The lease of a run as the database has it."""

    fence: int
    beat: int
    lapse_ms: int
    free: bool
    holder: str
    machine: str
    process: int
    started: str

    @property
    def identity(self) -> ProcessIdentity:
        """The process that holds it."""
        return ProcessIdentity(self.machine, self.process, self.started)


def account_name() -> str:
    """The account that this process works for, and its machine."""
    try:
        name = getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        name = str(os.getuid())
    return f"{name}@{platform.node()}"


def elapsed_s() -> float:
    """Seconds on a clock that never jumps, and that goes on while the machine sleeps if there is
    such a clock.
    """
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


def own_identity() -> ProcessIdentity:
    """This process."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
        machine = f"{boot}/{os.readlink('/proc/self/ns/pid')}"
    except OSError:
        machine = ""
    return ProcessIdentity(machine, os.getpid(), _process_start(os.getpid()))


def is_gone(process: ProcessIdentity) -> bool:
    """Whether a process of this system has ended for sure."""
    return bool(process.machine) and (
        process.machine == own_identity().machine
        and _process_start(process.process) != process.started
    )


def _process_start(process: int) -> str:
    """When a process of this system was started; empty if there is none that lives."""
    try:
        said = Path(f"/proc/{process}/stat").read_text("utf-8", "replace")
    except OSError:
        return ""
    fields = said.rpartition(")")[2].split()  # the name of a program may hold anything
    state, started = fields[0], fields[19]
    return "" if state in ("Z", "X") else started


class RunLease(Database):
    """The right to drive one run. `fence` is its number; 0 until it was taken.

    Raises `InvalidInput` if the database cannot be used, or if it is a file on a network drive,
    where SQLite cannot keep processes of two machines apart.
    """

    def __init__(
        self,
        store: str,
        run: str,
        pace: LeasePace = LeasePace(),
        clock: Callable[[], float] = elapsed_s,
    ) -> None:
        refuse_network_drive(store)
        super().__init__(store, of_run=True)
        self.run, self.pace, self.clock = run, pace, clock
        self.fence = 0
        self._lost = self._closed = False
        self._confirmed = float("-inf")
        self._over = threading.Event()
        self._beating: threading.Thread | None = None
        with open_transaction(self._engine, store, writes=True) as connection:
            lock_key(connection, MIGRATION)
            metadata.create_all(connection)

    def take(self, waits: bool = True) -> None:
        """Take the lease, and keep it: its beat goes on in a thread.

        Where another process holds it, this waits until a beat of it is seen, or none for too long;
        unless it shall not wait. Raises `InvalidInput` if another process drives the run.
        """
        first = self._look()
        since = self.clock()
        while not self._try_to_take(first, since):
            if not waits:
                raise self._refusal(first)
            time.sleep(self.pace.look_s)
            stored = self._look()
            if stored is None or stored.free:
                first = stored
            elif first is None or stored[:2] != first[:2]:
                raise self._refusal(stored)
        self._beating = threading.Thread(target=self._beat, daemon=True, name="lease of a run")
        self._beating.start()

    def _look(self) -> StoredLease | None:
        asked = select(*list(leases.columns)[1:]).where(leases.c.run == self.run)
        with open_transaction(self._engine, self.target) as connection:
            row = connection.execute(asked).first()
        return None if row is None else StoredLease(*row)

    def _try_to_take(self, stored: StoredLease | None, since: float) -> bool:
        """Take the lease if it is free, or if its holder is gone."""
        now = self.clock()
        held = stored is not None and not stored.free and not is_gone(stored.identity)
        if stored is not None and held and now - since < stored.lapse_ms / 1000:
            return False
        fence = max(stored.fence + 1 if stored else 1, int(time.time()))
        values = {
            "fence": fence,
            "beat": 0,
            "lapse_ms": int(self.pace.lapse_s * 1000),
            "free": False,
            "holder": account_name(),
            **own_identity()._asdict(),
        }
        with open_transaction(self._engine, self.target, writes=True) as connection:
            if not _replace_lease(connection, self.run, stored, values):
                return False
        self.fence, self._confirmed = fence, now
        return True

    def _refusal(self, stored: StoredLease | None) -> InvalidInput:
        who = f"{stored.holder}, process {stored.process}" if stored else "another process"
        reason = f"the run {self.run} is driven by {who}"
        return InvalidInput([Diagnostic(Source(self.run), "K421", reason, "stop it there first")])

    def _beat(self) -> None:
        while not self._over.wait(self.pace.beat_s):
            with contextlib.suppress(InvalidInput):  # the next beat may get through
                if not self._renewed():
                    return

    def _renewed(self) -> bool:
        """Count the beat up; False, and the lease is lost, if it is another one's."""
        began = self.clock()
        own = (leases.c.run == self.run) & (leases.c.fence == self.fence)
        with open_transaction(self._engine, self.target, writes=True) as connection:
            beat = update(leases).where(own).values(beat=leases.c.beat + 1)
            if connection.execute(beat).rowcount != 1:
                self._lost = True
                return False
        self.confirm(began)
        return True

    def confirm(self, began: float) -> None:
        """A beat was counted by something that began at a time of the clock."""
        self._confirmed = max(self._confirmed, began)

    def lose(self) -> None:
        """Another process has taken the lease."""
        self._lost = True

    @property
    def is_lost(self) -> bool:
        """Whether another process has taken the lease for sure."""
        return self._lost

    def require(self) -> None:
        """Return if no other process can hold the lease.

        Raises `LeaseLost` if one has taken it, `JournalFailure` if the database does not say.
        """
        if not self._lost and self._is_believed():
            return
        try:
            held = not self._lost and self._renewed()
        except InvalidInput as error:
            raise JournalFailure(error.diagnostics[0].message) from error
        if not held:
            raise LeaseLost(self.run)

    def _is_believed(self) -> bool:
        return self.clock() - self._confirmed < BELIEVED_SHARE * self.pace.lapse_s

    def stop_beat(self) -> None:
        """Count no beat any more, but with records."""
        self._over.set()
        if self._beating is not None:
            self._beating.join()

    def close(self) -> None:
        """Give the lease back if it is held, and close all connections."""
        self.stop_beat()
        if self.fence and not self._closed:
            own = (leases.c.run == self.run) & (leases.c.fence == self.fence)
            with (
                contextlib.suppress(InvalidInput),  # then the beat stands still
                open_transaction(self._engine, self.target, writes=True) as connection,
            ):
                connection.execute(update(leases).where(own).values(free=True))
        self._closed = True
        super().close()


def taken_lease(
    store: str, run: str, waits: bool = True, pace: LeasePace = LeasePace()
) -> RunLease:
    """The lease of a run, for this process. Raises `InvalidInput` if another one drives the run."""
    lease = RunLease(store, run, pace)
    try:
        lease.take(waits)
    except BaseException:
        lease.close()
        raise
    return lease


def _replace_lease(
    connection: Connection, run: str, stored: StoredLease | None, values: dict[str, object]
) -> bool:
    """Write a lease in the place of one that was seen; False if it has changed meanwhile."""
    if stored is None:
        try:
            with connection.begin_nested():
                connection.execute(insert(leases).values(run=run, **values))
        except IntegrityError:
            return False
        return True
    seen = (leases.c.run == run) & (leases.c.fence == stored.fence)
    seen &= leases.c.beat == stored.beat
    return connection.execute(update(leases).where(seen).values(**values)).rowcount == 1


def refuse_network_drive(store: str) -> None:
    """Raises `InvalidInput` if a store is a file on a network drive."""
    if "://" in store and not store.startswith("sqlite"):
        return
    if system := network_drive(Path(store.removeprefix("sqlite:///"))):
        message = (
            f"this file is on a network drive ({system}): SQLite cannot keep hosts apart there"
        )
        hint = "take a file on a disk of this machine, or postgresql://USER@HOST/DATABASE"
        raise store_refusal(store, message, hint)
