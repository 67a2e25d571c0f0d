"""Compiled modules as the plain Python that they are made of."""

import importlib
import importlib.util
import sys
from importlib.machinery import FileFinder, SourceFileLoader
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


def interpreted_package(package: ModuleType) -> dict[str, ModuleType]:
    """All modules of a package from their sources, by their last names: they see each other,
    and nothing else sees them.
    """
    folder = Path(str(package.__file__)).parent
    names = sorted(each.stem for each in folder.glob("*.py") if each.stem != "__init__")
    finder = FileFinder(str(folder), (SourceFileLoader, [".py"]))
    hidden = {name: sys.modules.pop(f"{package.__name__}.{name}", None) for name in names}
    shown = {name: vars(package).pop(name) for name in names if name in vars(package)}

    class Sources:
        """Finds the package's modules by their sources alone."""

        @staticmethod
        def find_spec(name: str, *_: object) -> object:
            return finder.find_spec(name) if name.startswith(f"{package.__name__}.") else None

    sys.meta_path.insert(0, Sources)  # type: ignore[arg-type]
    try:
        return {name: importlib.import_module(f"{package.__name__}.{name}") for name in names}
    finally:
        sys.meta_path.remove(Sources)  # type: ignore[arg-type]
        for name in names:
            sys.modules.pop(f"{package.__name__}.{name}", None)
            vars(package).pop(name, None)
        sys.modules.update(
            {f"{package.__name__}.{name}": each for name, each in hidden.items() if each}
        )
        vars(package).update(shown)
