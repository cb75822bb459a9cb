"""What is read of a ledger with real proofs, and what is not used."""

from dataclasses import replace
from pathlib import Path

import pytest
from served_log import fixture_copy, serving

from zk0_flower import NotVerified, ProgramError
from zk0_flower.ledger import Ledger


def test_a_round_says_who_has_proven_what(ledger: Ledger) -> None:
    known = ledger.round(0)
    assert len(known.committed) == 3
    assert len(known.accepted) == 2
    assert known.accepted < known.committed
    (lazy, reason) = next(iter(known.refused.items()))
    assert known.committed - known.accepted == {lazy}
    assert "was refused: the SP1 proof" in reason
    assert known.losses is not None and known.losses.after < 0.9 * known.losses.before
    assert known.verdict == "the result was taken"
    assert known.result is not None and known.result != known.base
    assert ledger.opened() == 1
    assert ledger.weights_in_force() == known.result
    assert ledger.blob(known.result).exists()


def test_the_ledger_of_another_network_is_not_read(ledger: Ledger) -> None:
    other = replace(ledger, network="11" * 32, folder=ledger.folder.with_name("other"))
    with pytest.raises((NotVerified, ProgramError), match="11" * 32):
        other.audit()


def test_a_ledger_without_an_update_is_not_used(zk0: str, ledger: Ledger, tmp_path: Path) -> None:
    copy = fixture_copy(tmp_path / "pruned")
    update = "aa92035672ccebb810296a970b3d7b90eae3c40cf4e6a41111f6cd051a7f5858"
    (copy / "blobs" / "sha256" / update).unlink()
    with serving(zk0, copy) as address:
        with pytest.raises(NotVerified, match="FAILED.*" + update):
            replace(ledger, address=address, folder=tmp_path / "second").audit()


def test_a_log_that_nobody_serves_is_an_error(ledger: Ledger) -> None:
    with pytest.raises(ProgramError, match="http://127.0.0.1:1"):
        replace(ledger, address="http://127.0.0.1:1").audit()


def test_a_program_that_is_not_there_is_an_error(ledger: Ledger) -> None:
    with pytest.raises(ProgramError, match="/nowhere/zk0 cannot be started"):
        replace(ledger, program=replace(ledger.program, path="/nowhere/zk0")).audit()
