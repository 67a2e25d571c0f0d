"""The innermost loops of planning, compiled where there is a C compiler; elsewhere they run as plain Python."""

from Cython.Build import cythonize
from setuptools import Extension, setup

SOURCES = [
    Extension(
        f"engine.planning.{name}", [f"engine/planning/{name}.py"], depends=[f"engine/planning/{name}.pxd"]
    )
    for name in ("kernels", "supporters")
]
compiled = cythonize(SOURCES, build_dir="build")
for each in compiled:
    each.optional = True  # cythonize forgets it

setup(ext_modules=compiled)
