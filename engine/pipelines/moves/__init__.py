"""Plans that move: every step of a plan gets the paths of the arm that it needs, and the time that they take.

What an operator moves is declared in `cell.yaml`, under `operations`. What is gripped and what is left follows from the facts
before and after the step, so a plan's symbols become numbers only here.
"""

from cellwright.engine.pipelines.moves.walking import Walk

__all__ = ["Walk"]
