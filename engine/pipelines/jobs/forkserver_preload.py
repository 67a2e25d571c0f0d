"""Preload of the server that forks the pool's processes, so that it ends with the command.

The server would notice the end of the command only when everything is loaded. Elsewhere, loading
this module does nothing.
"""

import contextlib
import ctypes
import signal
import sys

from cellwright.kb.garbage_collection import search_seldom

PR_SET_PDEATHSIG = 1

if any("multiprocessing.forkserver" in argument for argument in sys.orig_argv):
    with contextlib.suppress(OSError, AttributeError):  # not Linux
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    search_seldom()  # while it loads; the processes look for themselves
