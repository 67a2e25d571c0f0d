"""Diagnostics and the model are imported everywhere, so they are light."""

import subprocess
import sys


def test_the_light_modules_load_nothing_heavy() -> None:
    heavy = "('pydantic', 'lark', 'clingo', 'networkx', 'numpy', 'yaml')"
    light = "kb.diagnostics, kb.terms, kb.model.domain, kb.model.problem, kb.model.plan"
    code = f"import sys, {light}; print([name for name in {heavy} if name in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
