"""How Cellwright is built: by setuptools, with a C compiler that the build brings where the machine has none.

This is the build backend (PEP 517) and what `setup.py` needs. Compiled is every module that has its types beside it, in a
`.pxd` file. `CELLWRIGHT_COMPILER` may name the compiler: `system`, `zig` or `none`; the build fails if the one it names
does not work. If it names none, the first that works is taken, and without any the modules stay plain Python.
"""

import functools
import importlib.machinery
import importlib.util
import os
import platform
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from setuptools import Distribution, Extension
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    build_wheel,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)
from setuptools.command.build_ext import build_ext
from setuptools.errors import BaseError, CCompilerError

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

COMPILERS = ("system", "zig")
# What Cython adds to every module that takes arrays: compiled once, in a module of its own, it takes a third of the time.
SHARED = "engine.kernels.shared"
POSIX = os.name == "posix"
# The same figures on every processor: no multiplication and addition in one rounding, no instruction that only some have.
# A sum that is too large wraps around, as NumPy's do. Nothing reads `errno` after a square root.
FLAGS = ["-O2", "-g0", "-ffp-contract=off", "-fwrapv", "-fno-math-errno"] if POSIX else ["/O2", "/fp:precise"]
ZIG = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]
# What Zig compiles for a Linux with the GNU library runs on all that NumPy runs on. Debian keeps a part of Python's headers apart.
GNU = ["-target", f"{platform.machine()}-linux-gnu.2.28", "-idirafter", "/usr/include"]
LINKED = {"darwin": ["-undefined", "dynamic_lookup"]}  # Python itself is linked when it loads the module
TRIAL = """#include <Python.h>
static PyModuleDef trial = {PyModuleDef_HEAD_INIT, "trial"};
PyMODINIT_FUNC PyInit_trial(void) { return PyModule_Create(&trial); }
"""


def get_requires_for_build_wheel(_settings: Any = None) -> list[str]:
    """What a wheel needs to be built, beside what pyproject.toml names: a compiler, if there is none."""
    named = os.environ.get("CELLWRIGHT_COMPILER")
    lacking = POSIX and not named and not works("system")
    return ["ziglang"] if named == "zig" or lacking else []


get_requires_for_build_editable = get_requires_for_build_wheel


@functools.cache
def compiler() -> str:
    """The compiler that is used: `system`, `zig` or `none`. Exits where one is named that does not work."""
    named = os.environ.get("CELLWRIGHT_COMPILER")
    if named == "none":
        return named
    if named and named not in COMPILERS:
        sys.exit(f"CELLWRIGHT_COMPILER is system, zig or none, not {named}")
    for each in [named] if named else COMPILERS:
        if works(each):
            return each
    if named:
        sys.exit(f"CELLWRIGHT_COMPILER={named}: it compiles no module that Python loads")
    print("No C compiler works here: the kernels stay plain Python, which is slow.", file=sys.stderr)
    return "none"


def kernels() -> list[Extension]:
    """The modules to compile; none without a compiler. One that fails is left out, unless the compiler is named."""
    if compiler() == "none":
        return []
    found = sorted(Path("engine").rglob("*.pxd"))
    return [_extension(SHARED, [], []), *(_kernel(types) for types in found)]


def _kernel(types: Path) -> Extension:
    """The module beside a file of types. It may have a file of C, too, with the same name and the ending `.h`."""
    name, header = ".".join(types.with_suffix("").parts), types.with_suffix(".h")
    sources, depends = [types.with_suffix(".py").as_posix()], [types.as_posix()]
    if not header.is_file():
        return _extension(name, sources, depends)
    written_out = ["-O3"] if POSIX else []  # its loops over a few vectors are better written out
    return _extension(name, sources, [*depends, header.as_posix()], written_out)


def _extension(name: str, sources: list[str], depends: list[str], flags: Sequence[str] = ()) -> Extension:
    return Extension(
        name,
        sources,
        depends=[*depends, Path(__file__).name],
        include_dirs=["."],
        extra_compile_args=[*FLAGS, *flags],
        libraries=["m"] if POSIX else [],
        optional="CELLWRIGHT_COMPILER" not in os.environ,
    )


class Build(build_ext):
    """Translates kernels to C and compiles them; only what is older than its sources."""

    using = ""  # a compiler; that of `compiler()` if not given

    def build_extensions(self) -> None:
        """Build all."""
        _translate(self.extensions)
        if (self.using or compiler()) == "zig":
            zig = [*ZIG, *(GNU if platform.libc_ver()[0] == "glibc" else [])]
            linker = [*zig, "-shared", *LINKED.get(sys.platform, [])]
            self.compiler.set_executables(compiler_so=[*zig, "-fPIC"], linker_so=linker)
        self.parallel = self.parallel or os.cpu_count()
        every = self.extensions
        shared = [each for each in every if each.name == SHARED]
        self._build(shared)
        if all(
            Path(self.get_ext_fullpath(each.name)).exists() for each in shared
        ):  # no kernel loads without it
            self._build([each for each in every if each.name != SHARED])
        self.extensions = every

    def _build(self, extensions: list[Extension]) -> None:
        self.extensions = extensions
        super().build_extensions()


def _translate(extensions: list[Extension]) -> None:
    """Replace Python by the C that Cython makes of it, where it is not made yet."""
    untranslated = [each for each in extensions if not each.sources or each.sources[0].endswith(".py")]
    if untranslated:
        from Cython.Build import cythonize

        made = cythonize(
            untranslated, build_dir="build", nthreads=os.cpu_count(), shared_utility_qualified_name=SHARED
        )
        sources = {each.name: each.sources for each in made}
        for each in untranslated:
            each.sources = sources[each.name]


@functools.cache
def works(using: str) -> bool:
    """Whether a compiler makes a module that this Python loads."""
    if using == "zig" and importlib.util.find_spec("ziglang") is None:
        return False
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        source = Path(folder, "trial.c")
        source.write_text(TRIAL)
        trial = Extension("trial", [str(source)], extra_compile_args=FLAGS)
        command = Build(Distribution({"name": "trial", "ext_modules": [trial]}))
        command.using = using
        command.build_lib = command.build_temp = folder
        try:
            command.ensure_finalized()
            command.run()
            _load("trial", command.get_ext_fullpath("trial"))
        except (BaseError, CCompilerError, ImportError, OSError):
            return False
    return True


def _load(name: str, path: str) -> None:
    loader = importlib.machinery.ExtensionFileLoader(name, path)
    spec = importlib.machinery.ModuleSpec(name, loader, origin=path)
    loader.exec_module(importlib.util.module_from_spec(spec))
