"""A ledger's folder as a served log."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from local_network import FIXTURES, free_address, stop, wait_for


def fixture_copy(to: Path) -> Path:
    """A copy of the committed ledger."""
    return Path(shutil.copytree(FIXTURES / "ledger", to))


@contextmanager
def serving(zk0: str, ledger: Path) -> Iterator[str]:
    """Serves the log of a ledger's folder, and returns its address."""
    address = free_address()
    server = subprocess.Popen([zk0, "ledger", "serve", str(ledger), "--listen", address], stderr=subprocess.DEVNULL)
    try:
        wait_for(address)
        yield f"http://{address}"
    finally:
        stop(server)
