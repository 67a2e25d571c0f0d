"""How Cellwright is built: by setuptools, with a C compiler that the build brings where the machine
has none.

This is the build backend (PEP 517) and what `setup.py` needs. Compiled is every module that has its
types beside it, in a `.pxd` file. `CELLWRIGHT_COMPILER` may name the compiler: `system`, `zig` or
`none`; the build fails if the one it names does not work. If it names none, the first that works is
taken, and without any the modules stay plain Python.

What was compiled is kept in the user's cache folder under a hash of all that it depends on, so that
the next checkout with the same source has it at once. `CELLWRIGHT_CACHE` names another folder, or
`none`.
"""

import contextlib
import functools
import hashlib
import importlib.machinery
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
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
# What Cython adds to every module that takes arrays: compiled once, in a module of its own, it
# takes a third of the time.
SHARED = "cellwright.engine.kernels.shared"
POSIX = os.name == "posix"
# The same figures on every processor: no multiplication and addition in one rounding, no
# instruction that only some have. A sum that is too large wraps around, as NumPy's do. Nothing
# reads `errno` after a square root.
FLAGS = (
    ["-O2", "-g0", "-ffp-contract=off", "-fwrapv", "-fno-math-errno"]
    if POSIX
    else ["/O2", "/fp:precise"]
)
ZIG = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]
# What Zig compiles for a Linux with the GNU library runs on all that NumPy runs on. Debian keeps a
# part of Python's headers apart.
GNU = ["-target", f"{platform.machine()}-linux-gnu.2.28", "-idirafter", "/usr/include"]
MOST = 400  # modules that are kept of earlier builds, some 60 MB
# Python itself is linked when it loads the module
LINKED = {"darwin": ["-undefined", "dynamic_lookup"]}
TRIAL = """#include <Python.h>
static PyModuleDef trial = {PyModuleDef_HEAD_INIT, "trial"};
PyMODINIT_FUNC PyInit_trial(void) { return PyModule_Create(&trial); }
"""


def get_requires_for_build_wheel(_settings: Any = None) -> list[str]:
    """What a wheel needs to be built, beside what pyproject.toml names: a compiler, if there is
    none.
    """
    named = os.environ.get("CELLWRIGHT_COMPILER")
    lacking = POSIX and not named and not works("system")
    return ["ziglang"] if named == "zig" or lacking else []


get_requires_for_build_editable = get_requires_for_build_wheel


@functools.cache
def compiler() -> str:
    """The compiler that is used: `system`, `zig` or `none`. Exits where one is named that does
    not work.
    """
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
    print(
        "No C compiler works here: the kernels stay plain Python, which is slow.", file=sys.stderr
    )
    return "none"


def kernels() -> list[Extension]:
    """The modules to compile; none without a compiler.

    One that fails is left out, unless the compiler is named.
    """
    if compiler() == "none":
        return []
    found = sorted(Path("cellwright", "engine").rglob("*.pxd"))
    return [_extension(SHARED, [], []), *(_kernel(types) for types in found)]


def _kernel(types: Path) -> Extension:
    """The module beside a file of types.

    It may have files of C, too, whose names begin with its own and end in `.h`.
    """
    name, headers = (
        ".".join(types.with_suffix("").parts),
        sorted(types.parent.glob(f"{types.stem}*.h")),
    )
    sources, depends = [types.with_suffix(".py").as_posix()], [types.as_posix()]
    if not headers:
        return _extension(name, sources, depends)
    written_out = ["-O3"] if POSIX else []  # its loops over a few vectors are better written out
    return _extension(
        name, sources, [*depends, *(each.as_posix() for each in headers)], written_out
    )


def _extension(
    name: str, sources: list[str], depends: list[str], flags: Sequence[str] = ()
) -> Extension:
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
        """Build all that is not kept from an earlier build."""
        every, folder = self.extensions, None if self.using else cache()
        kept = _kept(folder, every) if folder else {}
        self.extensions = [
            each for each in every if not _restored(kept.get(each.name), self._made(each))
        ]
        # What is kept must come from these sources, whatever the times of the files say.
        self.force = self.force or bool(kept)
        self._compile()
        for each in self.extensions:
            if each.name in kept and self._made(each).exists():
                _keep(self._made(each), kept[each.name])
        self.extensions = every

    def _compile(self) -> None:
        needed = self.extensions
        _translate(needed, force=bool(self.force))
        if (self.using or compiler()) == "zig":
            zig = [*ZIG, *(GNU if platform.libc_ver()[0] == "glibc" else [])]
            linker = [*zig, "-shared", *LINKED.get(sys.platform, [])]
            self.compiler.set_executables(compiler_so=[*zig, "-fPIC"], linker_so=linker)
        self.parallel = self.parallel or os.cpu_count()
        # The longest first, so that no processor waits for the last one.
        self.extensions = sorted(needed, key=lambda each: -sum(map(os.path.getsize, each.sources)))
        super().build_extensions()
        self.extensions = needed
        if any(each.name == SHARED and not self._made(each).exists() for each in needed):
            for each in needed:  # no kernel loads without it
                self._made(each).unlink(missing_ok=True)

    def _made(self, extension: Extension) -> Path:
        return Path(self.get_ext_fullpath(extension.name))


def cache() -> Path | None:
    """The folder of what earlier builds compiled; None if there shall be none or it cannot be
    made.
    """
    named = os.environ.get("CELLWRIGHT_CACHE")
    if named == "none":
        return None
    try:
        caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(named or Path(caches, "cellwright")) / "kernels"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # nobody's home is known
        return None
    return folder if os.access(folder, os.W_OK) else None


def _kept(folder: Path, extensions: list[Extension]) -> dict[str, Path]:
    """Where each module is kept: under a hash of its source, of all types, of this build and of
    what compiles it.
    """
    types = sorted(
        file
        for ending in ("pxd", "h")
        for file in Path("cellwright", "engine").rglob(f"*.{ending}")
    )
    common = hashlib.sha256(repr(_tools()).encode())
    for each in [Path(__file__), *types]:
        common.update(repr((each.name, each.read_bytes())).encode())
    found = {}
    for extension in extensions:
        own = common.copy()
        own.update(
            repr((extension.name, [Path(name).read_bytes() for name in extension.sources])).encode()
        )
        found[extension.name] = (
            folder / f"{own.hexdigest()}{sysconfig.get_config_var('EXT_SUFFIX')}"
        )
    return found


def _tools() -> list[object]:
    """What compiles: Python, Cython, the compiler with its version, and what the environment
    tells it.
    """
    named = os.environ.get("CC") or sysconfig.get_config_var("CC") or ""
    command = ZIG if compiler() == "zig" else str(named).split()
    said = (
        subprocess.run([*command, "--version"], capture_output=True, check=False).stdout
        if command
        else b""
    )
    told = [os.environ.get(name) for name in ("CC", "CFLAGS", "CPPFLAGS", "LDFLAGS", "LDSHARED")]
    cython = importlib.metadata.version("cython")
    return [
        sys.version,
        platform.platform(),
        sysconfig.get_config_var("CFLAGS"),
        cython,
        command,
        said,
        told,
    ]


def _restored(kept: Path | None, made: Path) -> bool:
    """Whether a module was kept; then it is in its place."""
    if kept is None or not kept.exists():
        return False
    made.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(OSError):
        os.utime(kept)  # it is in use
    _put(kept, made)
    return True


def _keep(made: Path, kept: Path) -> None:
    """Keep a module for later builds, and no more of them than `MOST`.

    A full disk keeps nothing.
    """
    with contextlib.suppress(OSError):
        _put(made, kept)
        oldest_last = sorted(kept.parent.iterdir(), key=lambda each: -each.stat().st_mtime)
        for each in oldest_last[MOST:]:
            each.unlink()


def _put(source: Path, target: Path) -> None:
    """Copy a file so that nobody ever sees a part of it."""
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        os.replace(shutil.copyfile(source, Path(folder, target.name)), target)


def _translate(extensions: list[Extension], force: bool) -> None:
    """Replace Python by the C that Cython makes of it, where it is not made yet."""
    untranslated = [
        each for each in extensions if not each.sources or each.sources[0].endswith(".py")
    ]
    if untranslated:
        from Cython.Build import cythonize

        made = cythonize(
            untranslated,
            build_dir="build",
            nthreads=os.cpu_count(),
            force=force,
            shared_utility_qualified_name=SHARED,
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
