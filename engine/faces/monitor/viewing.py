"""What a page looks at, and the views that show it."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from xml.sax.saxutils import escape

from cellwright.engine.faces.monitor.following import Follower, Watched
from cellwright.engine.faces.monitor.shared import Shared
from cellwright.engine.pipelines.execution.retracing import Taken


def picture(text: str) -> str:
    """A picture, dark where the page is; a sentence in its place as text, because names in it may look like HTML."""
    drawn = text.startswith(("<svg", "<?xml"))
    return text.replace("@media (prefers-color-scheme: dark)", ".body--dark") if drawn else escape(text)


@dataclass
class Look:
    """What a page looks at: a run as it stood after a record, at a time on its clock; `step` is what is chosen: a step
    as the plan writes it, a fact, or an object; `choose` chooses."""

    shared: Shared
    follower: Follower
    run: Watched
    clock_ms: float = 0.0
    step: str = ""
    choose: Callable[[str], None] = print

    def share(self, taken: Taken) -> float:
        """The share of a step's time that is over, from 0 to 1."""
        record = self.follower.records[taken.number - 1]
        ends = self.follower.ends_ms(taken.command)
        ends = record.at_ms + record.content["lasts_ms"] if ends is None else ends
        if self.clock_ms >= ends:
            return 1.0
        return max(0.0, (self.clock_ms - record.at_ms) / max(1, ends - record.at_ms))


class View(ABC):
    """A view of a run on a page; `name` is what its tab says."""

    name = ""

    def __init__(self, look: Look) -> None:
        self.look = look
        self.make()

    @abstractmethod
    def make(self) -> None:
        """Make what is shown, still empty."""

    def sign(self) -> object:
        """What else the view shows than the run at the time that is looked at: if it changes, the view is shown again."""
        return None

    @abstractmethod
    def show(self) -> None:
        """Show the run as it stands."""
