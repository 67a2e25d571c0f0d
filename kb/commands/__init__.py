"""Commands in words: the phrases of a domain turn sentences into goals and chains of stages.

A grammar generated from the phrases reads the sentences. It is loaded only when there is a
sentence.
"""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.kb.commands.phrase_meanings import Place as Place
    from cellwright.kb.commands.phrase_meanings import check_phrases as check_phrases
    from cellwright.kb.commands.sentence import understand_command as understand_command
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".phrase_meanings": (
                "Place",
                "check_phrases",
            ),
            ".sentence": ("understand_command",),
        },
    )
