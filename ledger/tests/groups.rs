//! The ledger records a group of entries as a whole or not at all, with one checkpoint. Groups give the same history as single
//! entries.

use crate::network::log::ORIGIN;
use crate::network::rounds::copy;
use crate::network::shelf::*;
use crate::network::votes::*;
use crate::network::*;
use proptest::prelude::*;
use rocksdb::DB;
use std::collections::BTreeSet;
use std::path::Path;
use zk0_circuits::NodeId;
use zk0_ledger::published::mirror::{mirror, MirrorError};
use zk0_ledger::published::tiles;
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::store::Store;
use zk0_ledger::{Ledger, LedgerError, ReplayReport};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::entries::entry::{needs_checkpoint, DisputeResolved, RandomnessDrawn};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{Dispute, Evidence, KeyRotation, KeyTakeover};
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::tlog::bundle;
use zk0_protocol::tlog::layout::{Tile, TileKind};
use zk0_protocol::{Body, Refusal, RefusalCode, RuleViolation, Signed};

fn verified(dir: &Path) -> ReplayReport {
    let report = replay(dir, None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    report
}

fn founded(dir: &Path) -> Ledger {
    Ledger::create(dir, genesis(), log_key(), T0).unwrap().0
}

/// Returns the sizes for which the database has a checkpoint.
fn checkpoints(dir: &Path) -> Vec<u64> {
    let store = Store::open_read_only(&dir.join("log")).unwrap();
    let size = store.size().unwrap();
    (1..=size)
        .filter(|size| store.checkpoint(*size).unwrap().is_some())
        .collect()
}

fn joining(nodes: std::ops::Range<u8>) -> Vec<Body> {
    let network = genesis().network_id();
    nodes
        .flat_map(|node| [enrolled(node), registered(&network, node)])
        .collect()
}

/// Returns enrolments of nodes that no other test uses.
fn strangers(numbers: std::ops::Range<u64>) -> Vec<Body> {
    let enrol = |number: u64| {
        let seed = [number.to_le_bytes(); 4].concat().try_into().unwrap();
        let key = ed25519_dalek::SigningKey::from_bytes(&seed);
        Body::NodeEnrolled(NodeEnrolled {
            node: NodeId(key.verifying_key().to_bytes()),
            name: format!("stranger {number}"),
        })
    };
    numbers.map(enrol).collect()
}

#[test]
fn a_group_has_one_checkpoint_and_a_receipt_for_each_entry() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = founded(dir.path());
    let receipts = ledger.append_all(T0 + 1, joining(0..20)).unwrap();
    assert_eq!(receipts.len(), 40);
    for (receipt, index) in receipts.iter().zip(1..) {
        let (checkpoint, entry) = receipt.verify(&genesis().log_key, ORIGIN).unwrap();
        assert_eq!((receipt.index, checkpoint.size), (index, 41));
        assert_eq!(ledger.entry(index).unwrap(), entry);
        assert_eq!(&ledger.first_receipt(index).unwrap(), receipt);
    }
    let missing = ledger.checkpoint_at(7);
    assert!(
        matches!(missing, Err(LedgerError::NoCheckpointAt(7))),
        "{missing:?}"
    );
    assert!(ledger.append_all(T0, Vec::new()).unwrap().is_empty());
    let single = ledger.append(T0 + 2, enrolled(20)).unwrap();
    assert_eq!(single.index, 41);
    ledger.append_all(T0 + 3, joining(21..23)).unwrap();
    let (state, checkpoint) = (ledger.state().clone(), ledger.checkpoint().to_vec());
    drop(ledger);
    assert_eq!(checkpoints(dir.path()), [1, 41, 42, 46]);
    let report = verified(dir.path());
    assert_eq!((report.entries, report.checkpoints), (46, 4));
    let ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
    assert_eq!(ledger.state(), &state);
    assert_eq!(ledger.checkpoint(), checkpoint);
}

#[test]
fn a_refused_entry_of_a_group_leaves_no_trace_and_the_others_are_recorded() {
    let expected = {
        let dir = tempfile::tempdir().unwrap();
        let mut ledger = founded(dir.path());
        ledger.append_all(T0, joining(0..2)).unwrap();
        ledger.append_all(T0, joining(5..6)).unwrap();
        ledger.append_all(T0, joining(6..8)).unwrap();
        (ledger.checkpoint().to_vec(), ledger.state().clone())
    };
    // The refused entry repeats an earlier entry of the group, or a recorded entry, or has a wrong signature, or is a second
    // genesis.
    for (at, refused) in [
        (2, enrolled(5)),
        (1, enrolled(1)),
        (0, Body::Genesis(genesis())),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let mut ledger = founded(dir.path());
        ledger.append_all(T0, joining(0..2)).unwrap();
        let mut bodies = joining(5..6);
        bodies.insert(at, refused.clone());
        let wanted_all = bodies.into_iter().map(|body| wanted(T0, body).unwrap());
        let outcomes = ledger.commit(wanted_all.collect()).unwrap();
        let refusals: Vec<_> = outcomes.iter().map(Result::is_err).collect();
        let expected_refusals: Vec<_> = (0..3).map(|place| place == at).collect();
        assert_eq!(refusals, expected_refusals);
        let recorded: Vec<_> = outcomes.into_iter().flatten().collect();
        assert_eq!(recorded, [5, 6]);
        // A group of which nothing is left writes nothing.
        let before = ledger.checkpoint().to_vec();
        for times in [1, 2] {
            let again = vec![wanted(T0, refused.clone()).unwrap(); times];
            let outcomes = ledger.commit(again).unwrap();
            assert!(outcomes.iter().all(Result::is_err), "{outcomes:?}");
        }
        assert_eq!(ledger.checkpoint(), before);
        ledger.append_all(T0, joining(6..8)).unwrap();
        let now = (ledger.checkpoint().to_vec(), ledger.state().clone());
        assert_eq!(now, expected);
        drop(ledger);
        verified(dir.path());
        let ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
        assert_eq!(ledger.state(), &expected.1);
    }
}

#[test]
fn entries_of_a_group_have_their_own_times_which_never_go_back() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = founded(dir.path());
    let times = [T0 + 5, T0 + 3, T0 + 9];
    let all = times.iter().zip(strangers(0..3));
    let all = all.map(|(time_ms, body)| wanted(*time_ms, body).unwrap());
    ledger.commit(all.collect()).unwrap();
    let recorded: Vec<_> = (1..4).map(|at| ledger.entry(at).unwrap().time_ms).collect();
    assert_eq!(recorded, [T0 + 5, T0 + 5, T0 + 9]);
    drop(ledger);
    verified(dir.path());
}

/// Makes a ledger with one group in whose midst commitments close.
fn with_closing(dir: &Path) -> Ledger {
    let mut ledger = founded(dir);
    ledger.append_all(T0, joining(0..3)).unwrap();
    let opening = Body::RoundOpened(opened(ledger.state(), T0));
    ledger.append(T0, opening).unwrap();
    let mut state = ledger.state().clone();
    let mut group = vec![enrolled(7)];
    for node in 0..3 {
        let commit = committed(&state, node, weights(0x10 + node));
        state.apply(&digest(0), &entry(T0, commit.clone())).unwrap();
        group.push(commit);
    }
    let closing = Body::CommitmentsClosed(commitments_closed(&state));
    group.extend([closing, enrolled(8), enrolled(9)]);
    ledger.append_all(T0, group).unwrap();
    ledger
}

#[test]
fn a_closing_in_a_group_has_the_checkpoint_that_witnesses_cosign() {
    let dir = tempfile::tempdir().unwrap();
    let ledger = with_closing(dir.path());
    let state = ledger.state().clone();
    let closing = state.round().unwrap().closing.unwrap();
    assert_eq!(closing.entry, 12);
    let receipt = ledger.first_receipt(closing.entry).unwrap();
    let (checkpoint, _) = receipt.verify(&genesis().log_key, ORIGIN).unwrap();
    assert_eq!((checkpoint.size, checkpoint.root), (13, closing.root));
    drop(ledger);
    assert_eq!(checkpoints(dir.path()), [1, 7, 8, 13, 15]);
    verified(dir.path());
    let ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
    assert_eq!(ledger.state(), &state);
}

#[test]
fn a_checkpoint_that_something_depends_on_may_not_be_missing() {
    let dir = tempfile::tempdir().unwrap();
    drop(with_closing(dir.path()));
    for size in [13u64, 15] {
        let copied = tempfile::tempdir().unwrap();
        copy(dir.path(), copied.path());
        let db = DB::open_default(copied.path().join("log")).unwrap();
        db.delete([&b"c"[..], &size.to_be_bytes()].concat())
            .unwrap();
        drop(db);
        let report = replay(copied.path(), None, &mut ());
        assert_eq!(report.verdict, Verdict::Failed, "{size}");
        let opened = Ledger::open(copied.path(), None, log_key()).map(drop);
        match opened {
            Err(LedgerError::BadEntry { index, why }) => {
                assert_eq!(index, size - 1);
                assert!(why.contains("checkpoint"), "{why}");
            }
            other => panic!("{size}: {other:?}"),
        }
    }
    // The log is still valid without a checkpoint within the group that nothing depends on.
    let db = DB::open_default(dir.path().join("log")).unwrap();
    db.delete([&b"c"[..], &7u64.to_be_bytes()].concat())
        .unwrap();
    drop(db);
    assert_eq!(verified(dir.path()).checkpoints, 4);
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
}

#[test]
fn any_checkpoint_of_another_tree_keeps_a_ledger_from_opening() {
    let dir = tempfile::tempdir().unwrap();
    drop(with_closing(dir.path()));
    let forged = |size: u64, root: u8| {
        zk0_protocol::Checkpoint {
            size,
            root: digest(root),
        }
        .sign(ORIGIN, &log_key())
        .unwrap()
    };
    // The log's own key signed these checkpoints. They are of another root, or of another size than their place states.
    for (place, text) in [(7u64, forged(7, 1)), (7, forged(8, 1)), (5, forged(5, 2))] {
        let copied = tempfile::tempdir().unwrap();
        copy(dir.path(), copied.path());
        let db = DB::open_default(copied.path().join("log")).unwrap();
        db.put([&b"c"[..], &place.to_be_bytes()].concat(), text)
            .unwrap();
        drop(db);
        assert!(Ledger::open(copied.path(), None, log_key()).is_err());
        let report = replay(copied.path(), None, &mut ());
        assert_eq!(report.verdict, Verdict::Failed);
        assert_eq!(report.findings[0].index, Some(place - 1));
    }
}

#[test]
fn the_opening_of_a_round_that_draws_its_nodes_has_the_checkpoint_that_draws_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut genesis = genesis();
    genesis.rules.participation = Participation::Sampled { nodes: 1 };
    let network = genesis.network_id();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis, log_key(), T0).unwrap();
    let joining = (0..6).flat_map(|node| [enrolled(node), registered(&network, node)]);
    let mut group: Vec<Body> = joining.collect();
    group.push(Body::RoundOpened(opened(ledger.state(), T0)));
    group.extend([enrolled(6), enrolled(7)]);
    ledger.append_all(T0, group).unwrap();
    let state = ledger.state().clone();
    assert_eq!(state.round().unwrap().sample.as_ref().unwrap().len(), 1);
    drop(ledger);
    assert_eq!(checkpoints(dir.path()), [1, 14, 16]);
    verified(dir.path());
    assert_eq!(
        Ledger::open(dir.path(), None, log_key()).unwrap().state(),
        &state
    );
    let db = DB::open_default(dir.path().join("log")).unwrap();
    db.delete([&b"c"[..], &14u64.to_be_bytes()].concat())
        .unwrap();
    drop(db);
    assert_eq!(replay(dir.path(), None, &mut ()).verdict, Verdict::Failed);
    assert!(Ledger::open(dir.path(), None, log_key()).is_err());
}

/// Applies `body` with two roots. The results may differ only if the root has to be signed. Within a group, other roots are not
/// even computed.
fn step(chain: &mut Chain, kinds: &mut BTreeSet<u8>, body: Body) {
    let with = |root: u8| {
        let mut state = chain.state.clone();
        let next = entry(chain.time_ms + 1, body.clone());
        state.apply(&digest(root), &next).unwrap();
        state
    };
    assert!(
        with(1) == with(2) || needs_checkpoint(&body),
        "the root decides about {body:?}"
    );
    kinds.insert(borsh::to_vec(&body).unwrap()[0]);
    chain.apply(body);
}

#[test]
fn nothing_follows_from_a_root_that_is_not_signed() {
    let mut kinds = BTreeSet::new();
    for participation in [
        Participation::All,
        Participation::Listed(vec![id(0)]),
        Participation::Sampled { nodes: 1 },
    ] {
        let mut genesis = genesis();
        genesis.rules.participation = participation;
        let chain = &mut Chain::founded(genesis);
        let network = *chain.state.network();
        for node in 0..8 {
            step(chain, &mut kinds, enrolled(node));
            step(chain, &mut kinds, registered(&network, node));
        }
        let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
        step(chain, &mut kinds, opening);
        let may = |state: &zk0_protocol::State, node: u8| {
            let commit = committed(state, node, weights(0x10 + node));
            let now = state.time_ms() + 1;
            state.check(&entry(now, commit)).is_ok()
        };
        let contributing: Vec<u8> = (0..8).filter(|node| may(&chain.state, *node)).collect();
        for &node in &contributing {
            let body = committed(&chain.state, node, weights(0x10 + node));
            step(chain, &mut kinds, body);
        }
        let closing = Body::CommitmentsClosed(commitments_closed(&chain.state));
        step(chain, &mut kinds, closing);
        let drawing = Body::RandomnessDrawn(drawn(&chain.state));
        step(chain, &mut kinds, drawing);
        let accepting = chain.state.entries();
        for (at, &node) in contributing.iter().enumerate() {
            let body = match at {
                1 => rejected(&chain.state, node, invalid_proof()),
                _ => accepted(&chain.state, node),
            };
            step(chain, &mut kinds, body);
        }
        let closing = Body::RoundClosed(closed(&chain.state, weights(0x50)));
        step(chain, &mut kinds, closing);
        let dispute = Dispute {
            network,
            disputer: governor(0),
            contribution: accepting,
            evidence: Evidence::Verification,
        };
        let disputed = chain.state.entries();
        let dispute = Body::Disputed(Signed::new(dispute, &governor_key(0)));
        step(chain, &mut kinds, dispute);
        let resolved = DisputeResolved {
            dispute: disputed,
            upheld: Some(invalid_proof()),
        };
        step(chain, &mut kinds, Body::DisputeResolved(resolved));
        // The node of the disputed contribution is suspended.
        let mut others = (0..8).filter(|node| *node != contributing[0]);
        let (rotating, third) = (others.next().unwrap(), others.next().unwrap());
        let rotation = KeyRotation {
            network,
            node: id(rotating),
            with: id(9),
        };
        let takeover = KeyTakeover { rotation };
        let rotated = Body::KeyRotated {
            rotation: Signed::new(rotation, &key(rotating)),
            takeover: Signed::new(takeover, &key(9)),
        };
        step(chain, &mut kinds, rotated);
        let proposal = proposed(&chain.state, 0, Action::Suspend(id(third)));
        step(chain, &mut kinds, proposal);
        for governor in 0..3 {
            let vote = voted(&chain.state, governor, 0, Ballot::For);
            step(chain, &mut kinds, vote);
        }
        chain.wait(VOTING + TIME_LOCK);
        let outcome = chain.state.outcome(0, chain.time_ms + 1).unwrap();
        step(chain, &mut kinds, settled(0, outcome));
    }
    // All kinds of entries but the genesis are tried. Commitments close and randomness is drawn in each round.
    let last = borsh::to_vec(&Body::RandomnessDrawn(RandomnessDrawn {
        round: 0,
        drawing: Drawing::Witnesses(Vec::new()),
    }));
    let last = last.unwrap()[0];
    assert_eq!(kinds, (1..=last).collect(), "a kind of entry is not tried");
}

#[test]
fn a_late_commitment_in_a_group_is_refused_for_its_own_reason() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = founded(dir.path());
    ledger.append_all(T0, joining(0..1)).unwrap();
    let opening = Body::RoundOpened(opened(ledger.state(), T0));
    ledger.append(T0, opening).unwrap();
    let commit = committed(ledger.state(), 0, weights(0x10));
    let late = ledger.append_all(T0 + COMMIT_WINDOW + 1, vec![enrolled(9), commit]);
    match late {
        Err(LedgerError::Rule(RuleViolation::Refused(Refusal {
            code: RefusalCode::Late { .. },
            ..
        }))) => {}
        other => panic!("{other:?}"),
    }
}

/// Mirrors the ledger with a checkpoint bundle that `change` has altered, and replays the mirror.
fn published_with(
    dir: &Path,
    change: impl Fn(&mut Vec<Vec<u8>>),
) -> Result<ReplayReport, MirrorError> {
    let store = Store::open_read_only(&dir.join("log")).unwrap();
    let size = store.size().unwrap();
    let mut shown = ShownLog {
        store: &store,
        size,
        instead: Default::default(),
    };
    let tile = Tile::at(TileKind::Checkpoints, 0, size).unwrap();
    let bytes = tiles::read(&store, size, &tile).unwrap().unwrap();
    let mut items: Vec<Vec<u8>> = bundle::split(&bytes, tile.width)
        .unwrap()
        .into_iter()
        .map(<[u8]>::to_vec)
        .collect();
    change(&mut items);
    let mut bytes = Vec::new();
    for item in &items {
        bundle::push(&mut bytes, item).unwrap();
    }
    shown.instead.insert(tile.to_string(), Some(bytes));
    let copied = tempfile::tempdir().unwrap();
    mirror(&shown, copied.path(), None, None)?;
    Ok(replay(copied.path(), None, &mut ()))
}

#[test]
fn a_mirror_of_groups_is_the_same_ledger_and_insists_on_the_same_checkpoints() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = with_closing(dir.path());
    // The ledger goes beyond the first bundle, and one group lies across the end of that bundle.
    ledger.append_all(T0, strangers(0..300)).unwrap();
    ledger.append_all(T0, strangers(300..310)).unwrap();
    drop(ledger);
    let original = verified(dir.path());
    assert_eq!(published_with(dir.path(), |_| {}).unwrap(), original);
    let without = |size: usize| published_with(dir.path(), |items| items[size - 1].clear());
    for size in [13] {
        match without(size) {
            Err(MirrorError::Checkpoint { index, why }) => {
                assert_eq!(index, size as u64 - 1);
                assert!(why.contains("missing"), "{why}");
            }
            other => panic!("{size}: {other:?}"),
        }
    }
    let fewer = without(7).unwrap();
    assert_eq!(fewer.verdict, Verdict::Verified);
    assert_eq!(fewer.checkpoints, original.checkpoints - 1);
    // The log's key signed this checkpoint in the midst of a group, but it is not of this tree.
    let forged = zk0_protocol::Checkpoint {
        size: 5,
        root: digest(1),
    };
    let forged = forged.sign(ORIGIN, &log_key()).unwrap();
    let with = published_with(dir.path(), |items| items[4] = forged.clone());
    assert!(
        matches!(with, Err(MirrorError::Checkpoint { index: 4, .. })),
        "{with:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// However the same entries are grouped, they make the same history.
    #[test]
    fn groups_of_any_size_make_the_same_history(sizes in prop::collection::vec(1usize..9, 1..12)) {
        let (one, many) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (mut singles, mut groups) = (founded(one.path()), founded(many.path()));
        let mut bodies = joining(0..24);
        for size in sizes {
            let group: Vec<Body> = bodies.drain(..size.min(bodies.len())).collect();
            for body in &group {
                singles.append(T0, body.clone()).unwrap();
            }
            groups.append_all(T0, group).unwrap();
            prop_assert_eq!(singles.checkpoint(), groups.checkpoint());
            prop_assert_eq!(singles.state(), groups.state());
        }
        drop((singles, groups));
        let (one, many) = (verified(one.path()), verified(many.path()));
        prop_assert_eq!((one.root, one.state), (many.root, many.state));
    }
}
