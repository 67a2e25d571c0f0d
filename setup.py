"""The kernels of forward search, compiled where there is a C compiler; elsewhere they run as plain Python."""

from Cython.Build import cythonize
from setuptools import Extension, setup

SOURCE = Extension(
    "engine.planning.kernels", ["engine/planning/kernels.py"], depends=["engine/planning/kernels.pxd"]
)
[kernels] = cythonize([SOURCE], build_dir="build")
kernels.optional = True  # cythonize forgets it

setup(ext_modules=[kernels])
