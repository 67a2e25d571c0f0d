"""Limits of time and memory of a whole command, and Ctrl-C where no search listens for it.

The system counts what is reserved, not what is used. Linear algebra (OpenBLAS) reserves a lot, and
where there is none it ends the process or tries for ever. So the system's limit is higher by what
such libraries reserve.
"""

import math
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from cellwright.engine.faces.cli.process.exit_codes import INTERRUPTED, LIMIT
from cellwright.kb import stopping
from cellwright.kb.stopping import StoppedByCaller

THREADS = "OPENBLAS_NUM_THREADS"  # each of them reserves as much again
RESERVED_MB = 160  # megabytes that libraries may reserve and not use
MEMORY_ERROR_WORDS = ("failed to map segment", "cannot allocate memory")
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


def limit_memory(megabytes: int | None) -> None:
    """Have the system refuse what goes far beyond a limit, to this process and to those it
    starts; None is no limit.
    """
    if megabytes is not None:
        os.environ.setdefault(THREADS, "1")
        _limit_address_space(min((megabytes + RESERVED_MB) * 2**20, sys.maxsize))


def lift_limit() -> None:
    """Let this process have what the system allows: what is left to do is to say that memory
    has run out.
    """
    import resource

    _limit_address_space(resource.getrlimit(resource.RLIMIT_DATA)[1])


def resident_mb() -> float:
    """The megabytes that this process has in memory; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * _PAGE / 2**20
    except (OSError, IndexError, ValueError):
        return 0.0


def is_short(error: BaseException) -> bool:
    """Whether an error says that there was no memory: also that of a library that could not be
    loaded for want of it.
    """
    error_text = str(error).lower()
    lacking = isinstance(error, ImportError) and any(
        error_words in error_text for error_words in MEMORY_ERROR_WORDS
    )
    return lacking or isinstance(error, MemoryError)


def _limit_address_space(wanted: int) -> None:
    import resource

    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(
        resource.RLIMIT_DATA, (wanted if most < 0 or wanted < 0 else min(wanted, most), most)
    )


HEARING = 0.5  # seconds from Ctrl-C until a search has to have heard it
# seconds that a command which was interrupted where it heard nothing may take for its answer
TELLING = 0.5
BUSY = 1.5  # seconds that a busy machine may add to that
ANSWERING = 10.0  # seconds that a search which has heard it may take for its best answer
LOOKING = 0.01  # seconds between two looks at the memory
MOMENT = 0.02  # seconds after which what was raised in a callback is raised again
WATCH_THREAD = "watch"  # of the thread


class CommandWatch:
    """What is watched: when the time is over, and whether the command has heard that it shall
    stop.
    """

    def __init__(self, seconds: float | None = None, megabytes: int | None = None) -> None:
        self.seconds, self.megabytes = seconds, megabytes
        self.short = False  # whether the memory has run out
        self.deadline = None if seconds is None else time.monotonic() + seconds
        self.tell: Callable[[int], None] = lambda _: None
        self.heard = self.answered = self.roused = False
        self.pressed = False  # whether Ctrl-C was, and is heard by the command
        self.asked = False  # whether the command is at work on its answer, and may be interrupted
        # for a person, or for a cell: then Ctrl-C is heard there, and `time_is_up` ends it
        self.waiting = False
        self.time_is_up: Callable[[], None] | None = None

    def is_time_up(self) -> bool:
        """Whether the time limit has passed."""
        return self.deadline is not None and time.monotonic() >= self.deadline

    def megabytes_left(self) -> float:
        """How much more memory the command may take."""
        return math.inf if self.megabytes is None else max(self.megabytes - resident_mb(), 0.0)

    def is_ending(self) -> bool:
        """Whether the command was told to end: what fails after that fails because of it."""
        return self.pressed or (self.roused and not self.short)

    def press(self, signal_number: int, frame: FrameType | None) -> None:
        """Ctrl-C in the main thread: it raises `KeyboardInterrupt` there."""
        self.pressed = True
        signal.default_int_handler(signal_number, frame)

    def start(self) -> None:
        """Watch from now on. Only the main thread may start it."""
        woken, alarm = os.pipe()
        os.set_blocking(alarm, False)
        signal.set_wakeup_fd(alarm, warn_on_full_buffer=False)
        signal.signal(signal.SIGALRM, self._rouse)
        threading.Thread(target=self._run, args=(woken,), name=WATCH_THREAD, daemon=True).start()

    def _run(self, woken: int) -> None:
        code, hearing = INTERRUPTED, HEARING
        try:
            if self._reason(woken) == LIMIT:
                code, hearing = LIMIT, 0.0 if self.short else max(0.05 * (self.seconds or 0), 0.2)
        except OSError:
            return
        self._await(hearing, 0.0)
        if not (self.answered or self.heard):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGALRM)
            self._await(TELLING if code == INTERRUPTED else 0.2, BUSY)
        if not self.answered:
            self._end(code)

    def _reason(self, woken: int) -> int:
        """Wait until the command has to end; the exit code that says why: of a limit, or of
        Ctrl-C.
        """
        while True:
            seconds_left = (
                None if self.deadline is None else max(self.deadline - time.monotonic(), 0)
            )
            if self.megabytes is not None:
                seconds_left = LOOKING if seconds_left is None else min(seconds_left, LOOKING)
            if select.select([woken], [], [], seconds_left)[0]:
                if set(os.read(woken, 64)) & {signal.SIGINT, signal.SIGTERM} and not self.waiting:
                    return INTERRUPTED
            elif self.is_time_up():
                self._end_waiting()
                return LIMIT
            if self.megabytes is not None and resident_mb() > self.megabytes and not self.answered:
                self.short = True
                return LIMIT

    def _end_waiting(self) -> None:
        """Wait until nobody is waited for any more."""
        if self.waiting and self.time_is_up is not None:
            self.time_is_up()
        while self.waiting:
            time.sleep(0.1)

    def _await(self, seconds: float, more: float) -> None:
        """Wait for the answer, and longer if the command has heard that it shall stop.

        On a busy machine `seconds` of the processor may last so many seconds `more`.
        """
        until, spent = time.monotonic() + seconds, time.process_time() + seconds
        while not self.answered:
            late = time.monotonic() - until
            if late > (ANSWERING if self.heard else more) or (
                late > 0 and not self.heard and time.process_time() > spent
            ):
                return
            time.sleep(0.02)

    def be_patient(self) -> None:
        """Pass over Ctrl-C while an answer is printed that Ctrl-C asked for.

        A process that does more must hear it again.
        """
        if _alone:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    def _rouse(self, _signal: int, _frame: FrameType | None) -> None:
        """In the main thread: end what it does there, if it is between question and answer."""
        if self.asked and not (self.heard or self.answered or self.roused):
            self.roused = True
            raise MemoryError if self.short else StoppedByCaller

    def _end(self, code: int) -> None:
        with suppress(Exception):
            self.tell(code)
        os._exit(code)


_now: CommandWatch | None = None
_alone = False  # whether this process was started as `cellwright`, and does nothing else


def current_watch() -> CommandWatch | None:
    """The watch over the command that runs, if there is one."""
    return _now


@contextmanager
def watching_command(seconds: float | None, megabytes: int | None) -> Iterator[None]:
    """A context in which a command is watched, if this is the main thread of a process of its
    own.
    """
    global _now
    limit_memory(megabytes)
    _now = watch = CommandWatch(seconds, megabytes)
    if _alone:
        watch.start()
    try:
        with stopping.asking_to_stop(watch.is_time_up, watch.megabytes_left):
            yield
    finally:
        watch.answered, _now = True, None


def is_own_process() -> bool:
    """Whether this process does nothing but the command."""
    return _alone


def own_process() -> None:
    """Say that this process does nothing but the command, so that it may be ended."""
    global _alone
    _alone = True
    sys.unraisablehook = _raise_again


def _raise_again(lost: "sys.UnraisableHookArgs") -> None:
    """End the command a moment later, where its end was raised in a callback: Python prints
    such an exception and goes on.
    """
    if not isinstance(lost.exc_value, StoppedByCaller | KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    if _now is not None:
        _now.roused = False
    missed_signal = signal.SIGALRM if isinstance(lost.exc_value, StoppedByCaller) else signal.SIGINT
    threading.Timer(MOMENT, _signal_main_thread, (missed_signal,)).start()


def _signal_main_thread(which: signal.Signals) -> None:
    """Send the main thread a signal when it has left `_raise_again`, from where Python passes no
    exception on either: on a busy machine it may be there for longer than a moment."""
    main = threading.main_thread().ident or 0
    while _raises_again(sys._current_frames().get(main)):
        time.sleep(MOMENT)
    signal.pthread_kill(main, which)


def _raises_again(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code is not _raise_again.__code__:
        frame = frame.f_back
    return frame is not None
