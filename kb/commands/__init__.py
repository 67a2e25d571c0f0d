"""Commands in words: the phrases of a domain turn sentences into goals and chains of stages.

A grammar generated from the phrases reads the sentences. The parser library is imported only when
there is a sentence.
"""

import dataclasses
from collections.abc import Callable

from cellwright.kb.commands.phrase_meanings import Place, check_phrases
from cellwright.kb.diagnostics import Source
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem

__all__ = ["Place", "check_phrases", "understand_command"]


def understand_command(
    target: Problem | Domain, text: str, place: Callable[[int], Source] | None = None
) -> Problem:
    """The problem with the goal and chains of a command in words. For a domain, the problem starts
    from its defaults.

    `place` gives the place of character n of the text; without it, places are in the text itself.
    Raises `InvalidInput`.
    """
    from cellwright.kb.commands.sentence import read_sentence

    problem = target if isinstance(target, Problem) else Problem("command", target)
    goal, chains, windows = read_sentence(problem, text, place or command_line_place(text))
    return dataclasses.replace(
        problem, goal=goal, chains=chains, windows=(*problem.windows, *windows)
    )


def command_line_place(text: str) -> Callable[[int], Source]:
    """A function from a character of a text on the command line to its place."""

    def where(offset: int) -> Source:
        start = text.rfind("\n", 0, offset) + 1
        line = text[start:].partition("\n")[0]
        return Source("--command", text.count("\n", 0, offset) + 1, offset - start + 1, line)

    return where
