"""Runs the program ``zk0``."""

import json
import os
import subprocess
from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from typing import Any


class ProgramError(RuntimeError):
    """The program cannot be started, or it failed. The message ends with what the program said."""


def installed() -> str | None:
    """The file of the program that the wheel ``zk0`` installed, or ``None`` without that wheel."""
    try:
        found = files("zk0") or []
    except PackageNotFoundError:
        return None
    return next((os.path.realpath(str(file.locate())) for file in found if file.name == "zk0"), None)


@dataclass(frozen=True)
class Program:
    """The program ``zk0``."""

    path: str = installed() or "zk0"
    """Its file, or its name if it is on the ``PATH``. The default is the installed one."""

    def run(self, *arguments: str, codes: Collection[int] = (0,)) -> str:
        """Returns what the program prints.

        Raises `ProgramError` if it cannot be started, or if it ends with an exit code that is not one of ``codes``.
        """
        try:
            done = subprocess.run(
                [self.path, *arguments],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                check=False,
            )
        except OSError as error:
            raise not_started(self.path, error) from error
        if done.returncode not in codes:
            command = " ".join(["zk0", *arguments])
            raise ProgramError(f"`{command}` ended with exit code {done.returncode}: {last_words(done.stderr)}")
        return done.stdout

    def json(self, *arguments: str, codes: Collection[int] = (0,)) -> Any:
        """Returns the JSON that the program prints. Raises `ProgramError` as `run` does."""
        printed = self.run(*arguments, codes=codes)
        try:
            return json.loads(printed)
        except json.JSONDecodeError as error:
            command = " ".join(["zk0", *arguments])
            raise ProgramError(f"`{command}` printed no JSON: {error}") from error


def not_started(path: str, error: OSError) -> ProgramError:
    """The error of a program that cannot be started."""
    return ProgramError(f"the program {path} cannot be started ({error.strerror}): install it with `pip install zk0`, or name its file")


def last_words(log: str) -> str:
    """The last line of a log that says something: where a program fails, it says the reason last."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    return lines[-1].removeprefix("error: ") if lines else "it said nothing"
