//! A history with something of every kind, and entries that a hostile aggregator might put after any part of it.

use zk0_protocol::entries::entry::DisputeResolved;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{
    Dispute, Evidence, KeyRotation, KeyTakeover, SignableStatement,
};
use zk0_protocol::{Body, Entry, Signed, State};

use super::targets::text;
use zk0_testkit::fuzzing::Target;
use zk0_testkit::network::votes::{proposed, settled, voted};
use zk0_testkit::network::{
    accepted, closed, commitments_closed, committed, digest, drawn, enrolled, entry, genesis,
    governor_key, id, invalid_proof, key, opened, registered, rejected, weights, Chain, T0,
    TIME_LOCK, VOTING,
};

/// A state with something in each of its parts, and the entries that lead to it.
pub fn history() -> (State, Vec<Entry>) {
    let mut chain = Chain::new();
    let mut entries = vec![entry(T0, Body::Genesis(genesis()))];
    let network = *chain.state.network();
    let mut step = |chain: &mut Chain, body: Body| {
        entries.push(entry(chain.time_ms + 1, body.clone()));
        chain.apply(body);
    };
    for node in 0..3 {
        step(&mut chain, enrolled(node));
        step(&mut chain, registered(&network, node));
    }
    for round in 0..2 {
        if round == 1 {
            between_rounds(&mut chain, &mut step);
        }
        let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
        step(&mut chain, opening);
        for node in 0..3 {
            let body = committed(&chain.state, node, weights(0x10 + 4 * round + node));
            step(&mut chain, body);
        }
        let body = Body::CommitmentsClosed(commitments_closed(&chain.state));
        step(&mut chain, body);
        let body = Body::RandomnessDrawn(drawn(&chain.state));
        step(&mut chain, body);
        if round == 1 {
            break;
        }
        let body = accepted(&chain.state, 0);
        step(&mut chain, body);
        for node in 1..3 {
            let body = rejected(&chain.state, node, invalid_proof());
            step(&mut chain, body);
        }
        let body = Body::RoundClosed(closed(&chain.state, weights(0x50)));
        step(&mut chain, body);
    }
    let body = proposed(&chain.state, 0, Action::Suspend(id(2)));
    step(&mut chain, body);
    let body = voted(&chain.state, 1, 1, Ballot::Against);
    step(&mut chain, body);
    (chain.state, entries)
}

/// Takes the steps that are possible only while no round is open: disputes, a change of key, and the end of a proposal.
fn between_rounds(chain: &mut Chain, step: &mut impl FnMut(&mut Chain, Body)) {
    let network = *chain.state.network();
    let contribution = *chain.state.contributions().keys().next().unwrap();
    for evidence in [Evidence::Verification, Evidence::Document(digest(6))] {
        let dispute = Dispute {
            network,
            disputer: id(1),
            contribution,
            evidence,
        };
        let raised = chain.state.entries();
        step(chain, Body::Disputed(Signed::new(dispute, &key(1))));
        if evidence == Evidence::Verification {
            let resolved = DisputeResolved {
                dispute: raised,
                upheld: None,
            };
            step(chain, Body::DisputeResolved(resolved));
        }
    }
    step(chain, enrolled(3));
    let rotation = KeyRotation {
        network,
        node: id(3),
        with: id(NEXT),
    };
    let body = Body::KeyRotated {
        rotation: Signed::new(rotation, &key(3)),
        takeover: Signed::new(KeyTakeover { rotation }, &key(NEXT)),
    };
    step(chain, body);
    let body = proposed(&chain.state, 0, Action::Suspend(id(1)));
    step(chain, body);
    chain.wait(VOTING + TIME_LOCK);
    step(chain, settled(0, Outcome::NoQuorum));
}

/// The key that node 3 changes to.
const NEXT: u8 = 9;

/// The first byte states how many entries of the history come before. The rest is an entry that a hostile aggregator with members of
/// its own can put on its log. Its statements are signed anew if the test has their signer's key.
pub fn applied() -> Target {
    let (_, entries) = history();
    let mut states: Vec<Option<State>> = vec![None];
    for entry in &entries {
        let mut state = states.last().unwrap().clone();
        apply(&mut state, entry).unwrap();
        states.push(state);
    }
    let seeds = (0u8..)
        .zip(&entries)
        .map(|(at, entry)| [&[at][..], &entry.encode().unwrap()].concat())
        .collect();
    Target {
        seeds,
        run: Box::new(move |bytes| {
            let (at, bytes) = bytes.split_first().ok_or("no bytes at all")?;
            let mut entry = Entry::decode(bytes).map_err(text)?;
            sign_anew(&mut entry.body);
            let mut state = states[usize::from(*at) % states.len()].clone();
            apply(&mut state, &entry).map_err(without_parts)
        }),
    }
}

/// Returns one outcome for messages that other targets tell apart.
pub fn without_parts(message: String) -> String {
    let parts = ["genesis: evaluation", "genesis: rule", "signature"];
    let part = parts.iter().find(|part| message.starts_with(*part));
    part.map_or(message.clone(), |part| part.to_string())
}

fn apply(state: &mut Option<State>, entry: &Entry) -> Result<(), String> {
    match state {
        None => *state = Some(State::found(entry).map_err(text)?),
        Some(state) => {
            let root = digest(state.entries() as u8);
            state.apply(&root, entry).map_err(text)?;
        }
    }
    Ok(())
}

fn sign_anew(body: &mut Body) {
    fn anew<T: SignableStatement + Clone>(signed: &mut Signed<T>) {
        let keys = (0..=3).chain([NEXT]).map(key);
        let mut keys = keys.chain((0..3).map(governor_key));
        let signer = signed.statement.signer();
        if let Some(key) = keys.find(|key| key.verifying_key().to_bytes() == signer.0) {
            *signed = Signed::new(signed.statement.clone(), &key);
        }
    }
    match body {
        Body::DatasetCommitted(signed) => anew(signed),
        Body::UpdateCommitted(signed) => anew(signed),
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            anew(submission)
        }
        Body::KeyRotated { rotation, takeover } => {
            anew(rotation);
            anew(takeover);
        }
        Body::Proposed(signed) => anew(signed),
        Body::Voted(signed) => anew(signed),
        Body::Disputed(signed) => anew(signed),
        Body::NodeLeft(signed) => anew(signed),
        Body::OperatorDecided(signed) => anew(signed),
        _ => {}
    }
}
