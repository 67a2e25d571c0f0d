"""What a preparation notes of each problem in its ledger, and how that is read again."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from cellwright.engine.pipelines.preparation.results import KeptPoses, KeptSequence, Prepared


def finished(prepared: Prepared) -> bool:
    """Whether a problem need not be prepared again."""
    return prepared.finished


def written(prepared: Prepared) -> dict[str, Any] | None:
    """A result for the ledger. What is wrong with a file is told anew each time."""
    if prepared.diagnostics:
        return None
    content = dataclasses.asdict(prepared)
    del content["diagnostics"], content["finished"]
    return content


def read(content: Mapping[str, Any]) -> Prepared:
    """The result that the ledger holds."""
    sequence, poses = content["sequence"], content["poses"]
    rest = {key: value for key, value in content.items() if key not in ("sequence", "poses")}
    return Prepared(
        **rest,
        sequence=None if sequence is None else KeptSequence(**sequence),
        poses=None if poses is None else KeptPoses(**poses),
    )
