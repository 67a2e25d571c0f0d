"""The innermost loops, compiled where a C compiler is or can be had: `compiling.py` says how."""

from setuptools import setup

from compiling import Build, kernels

setup(ext_modules=kernels(), cmdclass={"build_ext": Build})
