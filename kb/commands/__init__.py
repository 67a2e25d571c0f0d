"""Commands in words: a domain's phrases, and sentences that become goals and chains of stages.

Sentences are read with a grammar generated from the phrases; the parser library is imported when a sentence comes.
"""

import dataclasses
from collections.abc import Callable

from kb.commands.phrases import Place, check_phrases
from kb.diagnostics import Source
from kb.model.domain import Domain
from kb.model.problem import Problem

__all__ = ["Place", "check_phrases", "understand"]


def understand(target: Problem | Domain, text: str, place: Callable[[int], Source] | None = None) -> Problem:
    """The problem (or the domain, from its defaults) with the goal and chains of a command in words.

    `place` says where character n of the text stands; without it the text itself is the place. Raises `InvalidInput`.
    """
    from kb.commands.sentence import read_sentence

    problem = target if isinstance(target, Problem) else Problem("command", target)
    goal, chains = read_sentence(problem, text, place or said(text))
    return dataclasses.replace(problem, goal=goal, chains=chains)


def said(text: str) -> Callable[[int], Source]:
    """The places of a text given on a command line, line by line."""

    def where(offset: int) -> Source:
        start = text.rfind("\n", 0, offset) + 1
        line = text[start:].partition("\n")[0]
        return Source("--command", text.count("\n", 0, offset) + 1, offset - start + 1, line)

    return where
