"""Weights of the ledger as Flower's arrays."""

import numpy as np
from safetensors.numpy import load_file

from zk0_flower import weights
from zk0_flower.ledger import Ledger, detail


def test_the_initial_weights_are_the_policys_rounded_once(ledger: Ledger) -> None:
    founded = ledger.program.json("audit", "show", str(ledger.folder / "mirror"), "0", "--json")
    file = ledger.blob(detail(founded, "initial weights"))
    policy = load_file(ledger.blob(detail(founded, "initial policy")))
    arrays = weights.read(file)
    bits = load_file(file)[weights.SCALES]
    assert len(arrays) == len(bits) > 10
    for (name, array), scale in zip(arrays.items(), bits, strict=True):
        # The policy's names have a prefix.
        (original,) = (tensor for full, tensor in policy.items() if full.endswith(name))
        given = array.numpy()
        assert given.dtype == np.float32 and given.shape == original.shape
        assert np.abs(given - original).max() <= 2.0 ** -(int(scale) + 1), name


def test_the_result_of_a_round_is_the_mean_of_its_contributions(ledger: Ledger) -> None:
    known = ledger.round(0)
    assert known.result is not None
    shown = ledger.program.json("audit", "show", str(ledger.folder / "mirror"), "--round", "0", "--json")
    updates = [weights.read(ledger.blob(detail(entry, "update"))) for entry in shown["entries"] if entry["kind"] == "accepted"]
    result, bits = weights.read(ledger.blob(known.result)), load_file(ledger.blob(known.result))[weights.SCALES]
    assert len(updates) == 2
    for name, scale in zip(result, bits, strict=True):
        mean = (updates[0][name].numpy() + updates[1][name].numpy()) / 2
        assert np.abs(result[name].numpy() - mean).max() <= 2.0 ** -(int(scale) + 1), name
