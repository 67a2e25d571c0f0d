"""Processes that end when the process that started them ends."""

import multiprocessing
import os
import threading


def end_with_parent() -> None:
    """End this process as soon as its parent is gone, killed perhaps: the queue of a pool would
    keep it waiting for ever.

    It is the initializer of a pool's processes, or a part of it.
    """
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
