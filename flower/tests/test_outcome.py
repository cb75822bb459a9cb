"""Who is left out of a round, and why."""

from dataclasses import replace

from zk0_flower.ledger import Ledger
from zk0_flower.messages import Reply
from zk0_flower.outcome import NO_REPLY, committed, judged
from zk0_flower.strategy import metrics


def test_only_the_ledger_says_who_has_contributed(ledger: Ledger) -> None:
    known = ledger.round(0)
    first, second = sorted(known.accepted)
    (refused,) = known.refused
    said = {
        1: Reply(first, 0),
        2: Reply(second, 0),
        3: Reply(refused, 0),
        # These say what is not true.
        4: Reply("00" * 32, 0),
        5: Reply(first, 7),
    }
    found, members, reasons = committed(said, {0: known})
    assert found == known
    assert members == {1: first, 2: second, 3: refused}
    assert set(reasons) == {4, 5} and all("the ledger has no such commitment" in reason for reason in reasons.values())

    outcome = judged(1, known, members, reasons | {6: NO_REPLY}, {})
    assert outcome.contributors == {first: 1, second: 2}
    left_out = {left.node: left.reason for left in outcome.left_out}
    assert set(left_out) == {3, 4, 5, 6}
    assert left_out[3] == known.refused[refused]
    assert left_out[6] == NO_REPLY
    said_of_it = metrics(known, len(outcome.left_out))
    assert (said_of_it["accepted"], said_of_it["refused"], said_of_it["left-out"]) == (2, 1, 4)
    assert known.losses is not None and said_of_it["proven-loss-after"] == known.losses.after


def test_who_takes_the_name_of_another_is_left_out_and_the_contribution_counts(ledger: Ledger) -> None:
    known = ledger.round(0)
    first, second = sorted(known.accepted)
    found, members, reasons = committed({1: Reply(first, 0), 2: Reply(second, 0), 3: Reply(first, 0)}, {0: known})
    outcome = judged(1, found, members, reasons, {})
    assert outcome.contributors == {first: None, second: 2}
    assert {left.node for left in outcome.left_out} == {1, 3}
    assert all("2 Flower nodes say that they are node " + first in left.reason for left in outcome.left_out)


def test_a_commitment_without_a_claim_is_named_with_what_the_node_said(ledger: Ledger) -> None:
    known = ledger.round(0)
    silent = replace(known, accepted=frozenset(), refused={})
    (first, *_) = sorted(known.committed)
    outcome = judged(1, silent, {1: first}, {}, {1: "it failed: the queue is full"})
    assert outcome.contributors == {}
    assert "proven nothing in time; it failed: the queue is full" in outcome.left_out[0].reason


def test_a_node_that_is_a_round_behind_is_left_out(ledger: Ledger) -> None:
    known = ledger.round(0)
    first, second = sorted(known.accepted)
    rounds = {0: known, 1: replace(known, number=1)}
    found, members, reasons = committed({1: Reply(first, 0), 2: Reply(second, 1)}, rounds)
    assert found == rounds[1] and members == {2: second}
    assert "committed in round 0, and the others in round 1" in reasons[1]


def test_no_commitment_is_no_round() -> None:
    assert committed({}, {}) == (None, {}, {})
    outcome = judged(1, None, {}, {1: NO_REPLY}, {})
    assert outcome.contributors == {} and outcome.left_out[0].node == 1
