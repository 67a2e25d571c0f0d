"""What is measured on a simulated part of which nothing is said: it is a good one."""

import random

from cellwright.engine.pipelines.measuring import Measuring
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function

SCATTER = 20.0  # the greatest standard deviation, and that of what has no limits
SHARE = 0.2  # of the way from the nominal value to a limit


class GoodPart:
    """Values near to the nominal ones, well inside of what is allowed. The same step measures the same in every run of a seed."""

    def __init__(self, problem: Problem, seed: int) -> None:
        self._measuring, self._seed = Measuring(problem), seed

    def value(self, step: Function, time: int) -> str:
        """What a step measures the n-th time it is taken: near to the nominal value, else to what is usual."""
        middle, scatter = self._usual(step)
        return str(round(middle + random.Random(f"{self._seed} {step} {time}").gauss(0, scatter)))

    def _usual(self, step: Function) -> tuple[float, float]:
        asked = self._measuring.expected(step)
        if asked is None:
            return 0.0, SCATTER
        if asked.nominal is None:
            return asked.usual, SCATTER
        ways = [abs(each - asked.nominal) for each in (asked.lower, asked.upper) if each is not None]
        return asked.nominal, min([SCATTER, *(SHARE * each for each in ways)])
