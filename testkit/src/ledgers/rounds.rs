//! A ledger with a whole round.

use crate::network::*;
use std::path::Path;
use zk0_ledger::Ledger;
use zk0_protocol::{Body, State};

/// A ledger of three nodes, with a closed round (one contribution accepted, two refused) and an open one.
pub fn ledger_with_a_round(dir: &Path) -> Ledger {
    let (mut ledger, _) = Ledger::create(dir, genesis(), log_key(), T0).unwrap();
    let mut clock = T0;
    let mut append = |ledger: &mut Ledger, body: fn(&State, u64, u8) -> Body, node: u8| {
        clock += 1;
        let body = body(ledger.state(), clock, node);
        ledger.append(clock, body).unwrap();
    };
    for node in 0..3 {
        append(&mut ledger, |_, _, node| enrolled(node), node);
        append(
            &mut ledger,
            |state, _, node| registered(state.network(), node),
            node,
        );
    }
    let open = |state: &State, clock, _| Body::RoundOpened(opened(state, clock));
    append(&mut ledger, open, 0);
    for node in 0..3 {
        append(
            &mut ledger,
            |state, _, node| committed(state, node, weights(0x10 + node)),
            node,
        );
    }
    append(
        &mut ledger,
        |state, _, _| Body::CommitmentsClosed(commitments_closed(state)),
        0,
    );
    append(
        &mut ledger,
        |state, _, _| Body::RandomnessDrawn(drawn(state)),
        0,
    );
    append(&mut ledger, |state, _, node| accepted(state, node), 0);
    for node in 1..3 {
        append(
            &mut ledger,
            |state, _, node| rejected(state, node, invalid_proof()),
            node,
        );
    }
    append(
        &mut ledger,
        |state, _, _| Body::RoundClosed(closed(state, weights(0x50))),
        0,
    );
    append(&mut ledger, open, 0);
    ledger
}

/// Copies a folder.
pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for found in std::fs::read_dir(from).unwrap() {
        let found = found.unwrap();
        let target = to.join(found.file_name());
        if found.file_type().unwrap().is_dir() {
            copy(&found.path(), &target);
        } else {
            std::fs::copy(found.path(), target).unwrap();
        }
    }
}
