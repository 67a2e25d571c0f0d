"""The parts of rich that answers in text are made of, loaded at first use: rich is slow to load."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from rich.console import Console as Console
    from rich.console import Group as Group
    from rich.table import Table as Table
    from rich.text import Text as Text
else:
    __getattr__ = open_doorway(
        __name__,
        {
            "rich.console": (
                "Console",
                "Group",
            ),
            "rich.table": ("Table",),
            "rich.text": ("Text",),
        },
    )
