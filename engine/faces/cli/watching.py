"""What a person sees of a run while it goes on: a live display with keys on a terminal, else plain lines."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwright.engine.model.execution import Record

FRAMES = 8  # a second
Give = Callable[[str], None]  # gives an order by its name


def plain(record: "Record") -> None:
    """Print what a record tells, on standard error."""
    from cellwright.engine.faces.cli.terminal import say
    from cellwright.engine.formats.report.narration import narrated

    for line in narrated(record):
        say(f"{line}\n")


@contextlib.contextmanager
def watched(
    run: str, give: Give, factor: float, before: "Sequence[Record]" = ()
) -> "Iterator[Callable[[Record], None]]":
    """A watcher for the records of a run: a live display on a terminal if its clock is slowed down, else plain lines.

    At full speed there is nothing to watch: a display would be gone before it is read. The display of a run that is taken up
    again begins with the records `before`.
    """
    if not (factor and sys.stderr.isatty() and sys.stdin.isatty()):
        yield plain
        return
    from rich.live import Live

    from cellwright.engine.faces.cli.terminal import console
    from cellwright.engine.formats.report.live import Display

    came = [time.monotonic()]
    display = Display(run, passed_ms=lambda: (time.monotonic() - came[0]) * 1000 / factor)
    for record in before:
        display.take(record)
    live = Live(display, console=console(stderr=True), refresh_per_second=FRAMES)
    keys = Keys(lambda key: _pressed(key, display, live, give))

    def follow(record: "Record") -> None:
        came[0] = time.monotonic()
        display.take(record)
        if not live.is_started:
            plain(record)

    with keys, live:
        yield follow


def _pressed(key: str, display: Any, live: Any, give: Give) -> None:
    match key:
        case "p":
            give(display.toggled())
        case "i":
            give("interrupt")
        case "s":
            give("stop")
        case "q":
            live.stop()
        case _:
            pass


class Keys:
    """Reads single keys from the terminal while it is entered, and leaves the terminal as it was."""

    def __init__(self, press: Callable[[str], None]) -> None:
        self._press = press
        self._over = threading.Event()
        self._before: Any = None

    def __enter__(self) -> "Keys":
        import termios
        import tty

        self._before = termios.tcgetattr(sys.stdin)
        tty.setcbreak(sys.stdin)
        threading.Thread(target=self._read, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        import termios

        self._over.set()
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        import select

        while not self._over.is_set():
            if select.select([sys.stdin], [], [], 1 / FRAMES)[0]:
                self._press(sys.stdin.read(1))
