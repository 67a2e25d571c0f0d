"""Compiled modules as the plain Python that they are made of."""

import importlib.util
from pathlib import Path
from types import ModuleType


def interpreted(compiled: ModuleType) -> ModuleType:
    """The same module from its source, where it is compiled and where it is not."""
    name = compiled.__name__.rpartition(".")[2]
    spec = importlib.util.spec_from_file_location(
        f"plain_{name}", Path(str(compiled.__file__)).with_name(f"{name}.py")
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
