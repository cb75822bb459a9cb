"""Which program runs."""

import sys
from pathlib import Path

import pytest

from zk0_flower.program import installed


def test_the_program_of_the_wheel_is_found_off_the_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel, program = tmp_path / "lib" / "zk0-9.dist-info", tmp_path / "bin" / "zk0"
    for folder in (wheel, program.parent):
        folder.mkdir(parents=True)
    (wheel / "METADATA").write_text("Metadata-Version: 2.4\nName: zk0\nVersion: 9\n")
    (wheel / "RECORD").write_text("zk0-9.dist-info/METADATA,,\n../bin/zk0,,\n")
    program.touch()
    monkeypatch.syspath_prepend(tmp_path / "lib")
    assert installed() == str(program)


def test_without_the_wheel_there_is_no_installed_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [])
    assert installed() is None
