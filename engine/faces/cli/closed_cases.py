"""`cellwright diagnose --history`, `--age`, `--reset`, `--import`: what was learned from closed cases."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.answers import Answer
from cellwright.engine.model.wording import counted

if TYPE_CHECKING:
    from cellwright.engine.model.cases import Diagnosis
    from cellwright.engine.pipelines.troubleshooting import Desk
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.store.cases import Cases


def kept(
    target: str, store: str, history: bool, reset: bool, age: float | None, given: Path | None
) -> Answer:
    """Forget, age or add closed cases of a domain, in this order, then list them. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.troubleshooting import fault_model
    from cellwright.engine.pipelines.troubleshooting.given import imported
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
    from cellwright.kb.store.cases import Cases

    if not store:
        raise InvalidInput([Diagnostic(Source("--store"), "K409", "no store is given", "give --store FILE")])
    model = fault_model(target)
    with Cases(store) as cases:
        said = []
        if reset:
            said.append(f"{cases.reset(model.domain)} cases forgotten")
        if age is not None:
            cases.discount(model.domain, age)
            said.append(f"the weights of cases are multiplied by {age:g}")
        if given is not None:
            added = imported(model, given)
            cases.add(added)
            said.append(f"{counted(len(added), 'count')} imported")
        return _history(model.domain, cases, said, history)


def lost_case(found: "Desk", made: "Diagnosis", store: str) -> "tuple[Diagnostic, ...]":
    """Keep a closed case, if there is a store; warnings if that fails, because the answer matters more."""
    from dataclasses import replace

    from cellwright.kb.diagnostics import InvalidInput

    try:
        if store:
            found.keep(made, store)
    except InvalidInput as error:
        return tuple(replace(each, warning=True) for each in error.diagnostics)
    return ()


def _history(domain: str, cases: "Cases", said: list[str], listed: bool) -> Answer:
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report.diagnosis import number
    from cellwright.engine.formats.report.rows import TextTable

    found = cases.history(domain)
    rows = [
        (e.exception, " and ".join(e.causes), number(e.weight), number(e.cost), str(len(e.observations)))
        for e in found
    ]
    table = TextTable(("exception", "cause", "counts for", "cost", "tests"), rows)
    content = {
        "cases": [
            {"exception": e.exception, "causes": list(e.causes), "weight": e.weight, "cost": e.cost}
            for e in found
        ]
    }
    parts: list[Any] = [*map(Text, said), *([table] if listed else [])]
    return Answer("ok", content, lambda: Group(*parts))
