"""The innermost loops of planning, compiled where there is a C compiler; elsewhere they run as plain Python.

Compiled is every module that has its types beside it, in a `.pxd` file.
"""

from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup


def extension(types: Path) -> Extension:
    """The module beside a file of types."""
    name = ".".join(types.with_suffix("").parts)
    return Extension(name, [str(types.with_suffix(".py"))], depends=[str(types)])


compiled = cythonize([extension(types) for types in sorted(Path("engine").rglob("*.pxd"))], build_dir="build")
for each in compiled:
    each.optional = True  # cythonize forgets it

setup(ext_modules=compiled)
