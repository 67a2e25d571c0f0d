"""A second Python process that is started anew, so that it inherits no lock.

A fork copies the locks that other threads hold, and nobody in the child ever lets them go: a
program with threads may then wait for ever. A program of its own has no such locks. It shares one
connection with its parent, and ends when the parent does.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.spawn import get_executable

# What the process runs: the first message says where modules are and which function is called.
PROGRAM = """\
import importlib, sys
from multiprocessing.connection import Connection
connection = Connection(int(sys.argv[1]))
try:
    sys.path[:], module, name = connection.recv()
    getattr(importlib.import_module(module), name)(connection)
except (EOFError, BrokenPipeError, ConnectionResetError):
    pass
"""


class CleanProcess:
    """A process that runs a public function of a module, with a connection to this process as its
    only argument.

    Ctrl-C of the terminal does not reach it: whoever started it says when it ends.
    """

    def __init__(self, function: Callable[[Connection], None], quiet: bool = False) -> None:
        self.connection, other_end = Pipe()
        with other_end:
            command = [get_executable(), "-P", "-c", PROGRAM, str(other_end.fileno())]
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL if quiet else None,
                pass_fds=(other_end.fileno(),),
                start_new_session=True,
            )
        self.owner = os.getpid()
        self.connection.send((sys.path, function.__module__, function.__qualname__))

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def kill(self) -> None:
        """End the process at once, whatever it does."""
        self.connection.close()
        if self.owner == os.getpid():
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
