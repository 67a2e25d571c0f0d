"""Diagnostics and the model are imported everywhere, so they are light."""

import subprocess
import sys


def test_the_light_modules_load_nothing_heavy() -> None:
    heavy = "('pydantic', 'lark', 'clingo', 'networkx', 'numpy', 'yaml')"
    light = "cellwright.kb.diagnostics, cellwright.kb.terms, cellwright.kb.model.domain, cellwright.kb.model.problem, cellwright.kb.model.plan"
    code = f"import sys, {light}; print([name for name in {heavy} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


def test_a_domain_loads_its_conventions_when_it_is_asked_for_them() -> None:
    """Tasks in PDDL ask for none."""
    code = (
        "import sys, cellwright.kb.model.domain as d; print('cellwright.kb.model.conventions' in sys.modules)"
    )
    code += "; d.Domain('cell').conventions; print('cellwright.kb.model.conventions' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["False", "True"]
