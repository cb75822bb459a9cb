"""Nodes that a ClientApp has left behind. Flower kills a ClientApp that it has not heard of for a minute, and starts it again. The node that the
first one has started would then run beside that of the second one, in the same state folder.
"""

import fcntl
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

PATIENCE_SECONDS = 30.0
"""How long a node may take to end that was left behind."""


class StillRunning(RuntimeError):
    """A node that was left behind does not end."""


@contextmanager
def the_only_one(path: Path) -> Iterator[TextIO]:
    """Ends the node that holds the lock file at ``path``, if there is one, and takes the lock.

    Returns the file, empty. A new node has to inherit it, and its process id has to be written to it. The lock is free when the node and this
    process have closed the file, so that the process id in a file that is locked is that of a node that runs. Raises `StillRunning`.
    """
    with path.open("a+") as lock:
        end = time.monotonic() + PATIENCE_SECONDS
        while not _taken(lock):
            if time.monotonic() > end:
                raise StillRunning(f"a node that was left behind does not end: stop the process that {path} names")
            lock.seek(0)
            if holder := lock.read():
                with suppress(ProcessLookupError):
                    os.kill(int(holder), signal.SIGTERM)
            time.sleep(0.2)
        lock.truncate(0)
        yield lock


def _taken(lock: TextIO) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
