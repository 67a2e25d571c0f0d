"""The records of a run, of which only some are in memory: others are read again from the journal when they are asked for."""

import threading
from array import array
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import overload

from cellwright.engine.model.execution import Record

PAGE = 500  # records that are read, and let go, together
PAGES = 12  # that are in memory at most
Read = Callable[[int, int], list[Record]]  # the records behind a number up to another one


class Kept(Sequence[Record]):
    """The records of a run in their order, as far as they are known; `read` gives those again that are no longer in memory.

    What is in memory does not grow with the run, but for 8 bytes a record.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._times = array("q")  # ms on the run's clock
        self._pages: OrderedDict[int, list[Record]] = OrderedDict()
        self._turning = threading.Lock()

    def append(self, record: Record) -> None:
        """One record more; its number is the next one."""
        with self._turning:
            self._page(len(self._times) // PAGE).append(record)
            self._times.append(record.at_ms)

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, at: int) -> Record: ...
    @overload
    def __getitem__(self, at: slice) -> list[Record]: ...
    def __getitem__(self, at: int | slice) -> Record | list[Record]:
        with self._turning:
            if isinstance(at, int):
                place = range(len(self))[at]
                return self._page(place // PAGE)[place % PAGE]
            return [self._page(place // PAGE)[place % PAGE] for place in range(len(self))[at]]

    def number_at(self, at_ms: float) -> int:
        """The number of the last record up to a time on the run's clock; 0 if there is none."""
        return bisect_right(self._times, at_ms)

    def _page(self, page: int) -> list[Record]:
        if page not in self._pages:
            self._pages[page] = self._read(PAGE * page, min(PAGE * (page + 1), len(self._times)))
            while len(self._pages) > PAGES:
                self._pages.popitem(last=False)
        self._pages.move_to_end(page)
        return self._pages[page]
