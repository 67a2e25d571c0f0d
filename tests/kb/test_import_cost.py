"""Diagnostics and the model are imported everywhere, so they are light."""

import subprocess
import sys


def test_the_light_modules_load_nothing_heavy() -> None:
    heavy = "('pydantic', 'lark', 'clingo', 'networkx', 'numpy', 'yaml')"
    light = (
        "cellwright.kb.diagnostics, cellwright.kb.terms, cellwright.kb.model.domain_model, "
        "cellwright.kb.model.planning_problem, cellwright.kb.model.plan_model"
    )
    code = f"import sys, {light}; print([name for name in {heavy} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_a_domain_loads_its_conventions_when_it_is_asked_for_them() -> None:
    """Tasks in PDDL ask for none."""
    code = (
        "import sys, cellwright.kb.model.domain_model as d; "
        "print('cellwright.kb.model.name_conventions' in sys.modules)"
    )
    code += (
        "; d.Domain('cell').conventions; print('cellwright.kb.model.name_conventions' in "
        "sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["False", "True"]


def loaded_after(*words: str) -> set[str]:
    """The modules of ours that a command has loaded when it ends."""
    code = (
        "import os, sys; from cellwright.engine.faces.cli import main; leave = os._exit; "
        f"os._exit = lambda code: (print(*sys.modules, file=sys.stderr), leave(code)); "
        f"sys.argv = ['cellwright', *{list(words)!r}]; main()"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name for name in ran.stderr.split() if name.startswith("cellwright.")}


def test_commands_load_only_the_stages_that_they_need() -> None:
    planned, sequenced = (
        loaded_after("plan", "themse/one"),
        loaded_after("sequence", "bulkhead/one_point"),
    )
    stages = "cellwright.engine.stages"
    assert f"{stages}.planning" in planned
    assert not any(name.startswith(f"{stages}.scheduling.flow") for name in planned)
    assert f"{stages}.sequencing" in sequenced
    for stage in ("planning", "grounding", "scheduling", "validation"):
        assert not any(name.startswith(f"{stages}.{stage}") for name in sequenced), stage
