"""Which releases of Flower this package works with."""

import re
from importlib.metadata import PackageNotFoundError, version

OLDEST = (1, 40)
"""The oldest release of ``flwr`` whose message API this package uses: major and minor number."""


class UnsupportedFlower(ImportError):
    """Flower is missing or too old."""


def check(installed: str) -> None:
    """Raises `UnsupportedFlower` unless ``installed``, a version such as ``1.41.0``, is recent enough."""
    numbers = tuple(int(number) for number in re.findall(r"\d+", installed)[:2])
    if numbers < OLDEST:
        wanted = ".".join(map(str, OLDEST))
        raise UnsupportedFlower(
            f"zk0-flower needs flwr {wanted} or later, and flwr {installed} is installed: run `pip install 'flwr>={wanted}'`"
        )


def check_installed() -> None:
    """Raises `UnsupportedFlower` unless a recent enough Flower is installed."""
    try:
        installed = version("flwr")
    except PackageNotFoundError as error:
        raise UnsupportedFlower("zk0-flower needs Flower: run `pip install flwr`") from error
    check(installed)
