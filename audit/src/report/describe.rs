//! Entries in words. Only this file must know every kind.

use zk0_circuits::{Losses, NodeId};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::{Body, RoundClosed};
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::Evidence;
use zk0_protocol::evaluation_set::total;
use zk0_protocol::{Entry, RefusalCode};

/// The entry in a sentence. It contains untrusted names: escape it before display.
pub fn describe(entry: &Entry) -> String {
    match &entry.body {
        Body::Genesis(genesis) => format!(
            "network '{}' was founded: {}",
            genesis.name,
            genesis.network_id()
        ),
        Body::NodeEnrolled(enrolled) => {
            format!("node {} was enrolled as '{}'", enrolled.node, enrolled.name)
        }
        Body::DatasetCommitted(signed) => format!(
            "node {} committed to a dataset of {}",
            signed.statement.node,
            counted(signed.statement.dataset.samples, "sample", "samples")
        ),
        Body::RoundOpened(opened) => format!(
            "round {} opened, for commitments until {}",
            opened.round,
            time(opened.commit_deadline_ms)
        ),
        Body::UpdateCommitted(signed) => format!(
            "node {} committed to an update in round {}",
            signed.statement.node, signed.statement.round
        ),
        Body::ContributionAccepted(submission) => format!(
            "the contribution of node {} in round {} was accepted",
            submission.statement.claim.terms.node, submission.statement.claim.terms.round
        ),
        Body::ContributionRejected { submission, reason } => format!(
            "the contribution of node {} in round {} was refused: {reason}",
            submission.statement.claim.terms.node, submission.statement.claim.terms.round
        ),
        Body::RoundClosed(closed) => closed_with(closed),
        Body::CommitmentsClosed(closed) => {
            format!("the commitments of round {} closed", closed.round)
        }
        Body::RandomnessDrawn(drawn) => format!(
            "the randomness of round {} was drawn from {}: {}",
            drawn.round,
            drawn.drawing,
            randomness(&drawn.drawing)
        ),
        Body::KeyRotated { rotation, .. } => format!(
            "{} changed its key to {}",
            rotation.statement.node, rotation.statement.with
        ),
        Body::Proposed(signed) => format!(
            "{} proposed '{}' (proposal {}): {}",
            signed.statement.proposer,
            signed.statement.title,
            signed.statement.number,
            action(&signed.statement.action)
        ),
        Body::NodeLeft(signed) => format!("node {} left", signed.statement.node),
        Body::OperatorDecided(signed) => {
            let done = if signed.statement.suspended {
                "suspended"
            } else {
                "reinstated"
            };
            format!("the operator {done} node {}", signed.statement.node)
        }
        Body::LogKeyRotated { rotation, .. } => {
            format!("the operator gave the log the key {}", rotation.statement.with)
        }
        Body::DeadlinesMoved(moved) => format!(
            "the deadlines of round {} moved by {} ms, after an outage",
            moved.round, moved.by_ms
        ),
        Body::MomentsComputed(computed) => {
            format!("the moments of round {} were computed", computed.round)
        }
        Body::FilesLost(lost) => format!(
            "a file of the accepted contribution of node {} in round {} is lost, and the aggregator asks the node for it",
            lost.node, lost.round
        ),
        Body::ContributionLeftOut(lost) => format!(
            "round {} leaves out the accepted contribution of node {}, because a file of it is lost",
            lost.round, lost.node
        ),
        Body::Voted(signed) => format!(
            "{} voted {} on proposal {}",
            signed.statement.voter,
            ballot(signed.statement.ballot),
            signed.statement.proposal
        ),
        Body::ProposalSettled(settled) => {
            format!("proposal {} was {}", settled.proposal, settled.outcome)
        }
        Body::Disputed(signed) => format!(
            "{} disputed the contribution of entry {}",
            signed.statement.disputer, signed.statement.contribution
        ),
        Body::DisputeResolved(resolved) => match &resolved.upheld {
            Some(reason) => format!(
                "the dispute of entry {} was upheld: {reason}",
                resolved.dispute
            ),
            None => format!("the dispute of entry {} was dismissed", resolved.dispute),
        },
    }
}

/// A drawing's randomness.
pub fn randomness(drawing: &Drawing) -> String {
    let value = drawing.value();
    value.map_or("none".into(), |value| value.to_string())
}

/// What a proposal would do.
pub fn action(action: &Action) -> String {
    match action {
        Action::ChangeRules(_) => "change the rules".into(),
        Action::Enrol(enrolled) => format!("enrol node {} as '{}'", enrolled.node, enrolled.name),
        Action::Suspend(node) => format!("suspend node {node}"),
        Action::Reinstate(node) => format!("reinstate node {node}"),
        Action::Revoke(node) => format!("revoke node {node}"),
        Action::ReplaceKey { node, with } => format!("replace the key of node {node} by {with}"),
        Action::JudgeDispute { dispute, upheld } => {
            if *upheld {
                format!("uphold the dispute of entry {dispute}")
            } else {
                format!("dismiss the dispute of entry {dispute}")
            }
        }
        Action::ReplaceProgram(program) => {
            format!("prove with the guest program {program} from the next round on")
        }
        Action::RestoreWeights { round } => {
            format!("start the next round from the weights that round {round} ended with")
        }
    }
}

/// How a round closed: contributions, commitments without a claim, and result.
fn closed_with(closed: &RoundClosed) -> String {
    let contributions = counted(
        closed.contributors.len() as u64,
        "contribution",
        "contributions",
    );
    let unanswered = match closed.unanswered.len() as u64 {
        0 => String::new(),
        silent => format!(
            " and {}",
            counted(
                silent,
                "commitment without a claim",
                "commitments without a claim"
            )
        ),
    };
    let outcome = closed.evaluated.as_ref().map(|one| one.outcome);
    let outcome = outcome.map_or(String::new(), |outcome| format!(", and {outcome}"));
    format!(
        "round {} closed with {contributions}{unanswered}{outcome}",
        closed.round
    )
}

fn ballot(ballot: Ballot) -> &'static str {
    match ballot {
        Ballot::For => "for it",
        Ballot::Against => "against it",
        Ballot::Abstain => "to abstain",
        Ballot::Veto => "to veto it",
    }
}

/// An entry's kind in a word or two.
pub fn kind(body: &Body) -> &'static str {
    match body {
        Body::Genesis(_) => "genesis",
        Body::NodeEnrolled(_) => "enrolment",
        Body::DatasetCommitted(_) => "dataset",
        Body::RoundOpened(_) => "round opened",
        Body::UpdateCommitted(_) => "commitment",
        Body::ContributionAccepted(_) => "accepted",
        Body::ContributionRejected { .. } => "refused",
        Body::RoundClosed(_) => "round closed",
        Body::KeyRotated { .. } => "key changed",
        Body::NodeLeft(_) => "left",
        Body::OperatorDecided(_) => "operator's decision",
        Body::LogKeyRotated { .. } => "log's key changed",
        Body::DeadlinesMoved(_) => "deadlines moved",
        Body::MomentsComputed(_) => "moments",
        Body::FilesLost(_) => "files lost",
        Body::ContributionLeftOut(_) => "left out",
        Body::Proposed(_) => "proposal",
        Body::Voted(_) => "vote",
        Body::ProposalSettled(_) => "proposal settled",
        Body::Disputed(_) => "dispute",
        Body::DisputeResolved(_) => "dispute resolved",
        Body::CommitmentsClosed(_) => "commitments closed",
        Body::RandomnessDrawn(_) => "randomness",
    }
}

/// An entry's nodes.
pub fn nodes(body: &Body) -> Vec<NodeId> {
    about(body).1
}

/// An entry's round.
pub fn round(body: &Body) -> Option<u64> {
    about(body).0
}

/// An entry's round and nodes.
fn about(body: &Body) -> (Option<u64>, Vec<NodeId>) {
    match body {
        Body::Genesis(_)
        | Body::LogKeyRotated { .. }
        | Body::ProposalSettled(_)
        | Body::DisputeResolved(_) => (None, vec![]),
        Body::NodeEnrolled(enrolled) => (None, vec![enrolled.node]),
        Body::DatasetCommitted(signed) => (None, vec![signed.statement.node]),
        Body::Voted(signed) => (None, vec![signed.statement.voter]),
        Body::NodeLeft(signed) => (None, vec![signed.statement.node]),
        Body::OperatorDecided(signed) => (None, vec![signed.statement.node]),
        Body::DeadlinesMoved(moved) => (Some(moved.round), vec![]),
        Body::Disputed(signed) => (None, vec![signed.statement.disputer]),
        Body::KeyRotated { rotation, .. } => {
            let rotation = &rotation.statement;
            (None, vec![rotation.node, rotation.with])
        }
        Body::Proposed(signed) => {
            let mut nodes = vec![signed.statement.proposer];
            match &signed.statement.action {
                Action::ChangeRules(_)
                | Action::JudgeDispute { .. }
                | Action::ReplaceProgram(_)
                | Action::RestoreWeights { .. } => {}
                Action::Enrol(enrolled) => nodes.push(enrolled.node),
                Action::Suspend(node) | Action::Reinstate(node) | Action::Revoke(node) => {
                    nodes.push(*node);
                }
                Action::ReplaceKey { node, with } => nodes.extend([*node, *with]),
            }
            (None, nodes)
        }
        Body::RoundOpened(opened) => (Some(opened.round), vec![]),
        Body::CommitmentsClosed(closed) => (Some(closed.round), vec![]),
        Body::RandomnessDrawn(drawn) => (Some(drawn.round), vec![]),
        Body::MomentsComputed(computed) => (Some(computed.round), vec![]),
        Body::FilesLost(lost) | Body::ContributionLeftOut(lost) => {
            (Some(lost.round), vec![lost.node])
        }
        Body::UpdateCommitted(signed) => {
            (Some(signed.statement.round), vec![signed.statement.node])
        }
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            let terms = &submission.statement.claim.terms;
            (Some(terms.round), vec![terms.node])
        }
        Body::RoundClosed(closed) => {
            let contributors = closed.contributors.iter().map(|one| one.node);
            let nodes = contributors.chain(closed.unanswered.iter().copied());
            (Some(closed.round), nodes.collect())
        }
    }
}

/// An entry's other contents, as labelled values.
pub fn details(body: &Body) -> Vec<(&'static str, String)> {
    match body {
        Body::Genesis(genesis) => vec![
            ("mode", genesis.mode.to_string()),
            ("initial policy", genesis.policy.to_string()),
            ("initial weights", genesis.initial.blob.to_string()),
        ],
        Body::NodeEnrolled(_) => Vec::new(),
        Body::DatasetCommitted(signed) => vec![
            ("root", signed.statement.dataset.root.to_string()),
            (
                "recording",
                format!(
                    "{} in {}, of which {} are drawn",
                    counted(total(&signed.statement.episodes), "frame", "frames"),
                    counted(
                        signed.statement.episodes.len() as u64,
                        "episode",
                        "episodes"
                    ),
                    signed.statement.drawn()
                ),
            ),
            ("drawn frames", signed.statement.leaves.to_string()),
        ],
        Body::RoundOpened(opened) => vec![
            ("base weights", opened.base.blob.to_string()),
            ("evaluation", opened.evaluation.to_string()),
        ],
        Body::UpdateCommitted(signed) => vec![
            ("update", signed.statement.update.blob.to_string()),
            ("dataset root", signed.statement.dataset_root.to_string()),
        ],
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            let claim = &submission.statement.claim;
            let losses = match claim.losses {
                Losses::Hidden => "not disclosed".into(),
                Losses::Disclosed {
                    before,
                    after,
                    elements,
                } => format!("{before} before, {after} after, over {elements} elements"),
            };
            vec![
                ("proof", submission.statement.proof.to_string()),
                ("base weights", claim.terms.base.blob.to_string()),
                ("update", claim.terms.update.blob.to_string()),
                ("challenge", claim.terms.challenge.to_string()),
                ("samples", claim.terms.eval_samples.to_string()),
                ("test", claim.terms.test.to_string()),
                ("squared errors", losses),
            ]
        }
        Body::RoundClosed(closed) => {
            let mut details = vec![("global weights", closed.global.blob.to_string())];
            if let Some(evaluated) = &closed.evaluated {
                let losses = format!(
                    "{} for the base and {} for the result, over {} elements",
                    evaluated.base, evaluated.result, evaluated.elements
                );
                details.push(("result", evaluated.weights.blob.to_string()));
                details.push(("public samples", losses));
            }
            for one in &closed.contributors {
                let share = format!(
                    "{} counts for {} % of the contributor in the middle and earned {}",
                    one.node,
                    f64::from(one.share) / 100.0,
                    counted(one.credits, "credit", "credits")
                );
                details.push(("contributor", share));
            }
            for node in &closed.unanswered {
                details.push((
                    "unanswered",
                    format!("{node} committed and submitted no claim"),
                ));
            }
            details
        }
        Body::CommitmentsClosed(closed) => vec![("commitments", closed.commitments.to_string())],
        Body::MomentsComputed(computed) => vec![("moments", computed.moments.to_string())],
        Body::RandomnessDrawn(drawn) => {
            let mut details = vec![
                ("source", drawn.drawing.to_string()),
                ("randomness", randomness(&drawn.drawing)),
            ];
            match &drawn.drawing {
                Drawing::LogVrf(proof) => details.push(("proof", hex::encode(proof.0))),
                Drawing::Drand { signature, .. } => {
                    details.push(("signature", hex::encode(signature)));
                }
                Drawing::Witnesses(cosignatures) => {
                    let all = cosignatures.iter();
                    details.extend(all.map(|one| ("cosignature", hex::encode(one))));
                }
            }
            details
        }
        Body::KeyRotated { .. }
        | Body::NodeLeft(_)
        | Body::OperatorDecided(_)
        | Body::DeadlinesMoved(_)
        | Body::LogKeyRotated { .. }
        | Body::ProposalSettled(_)
        | Body::DisputeResolved(_)
        | Body::FilesLost(_)
        | Body::ContributionLeftOut(_) => Vec::new(),
        Body::Proposed(signed) => vec![
            ("title", signed.statement.title.clone()),
            ("text", signed.statement.text.clone()),
            ("digest", signed.statement.digest().to_string()),
        ],
        Body::Voted(signed) => vec![("proposal", signed.statement.of.to_string())],
        Body::Disputed(signed) => vec![(
            "evidence",
            match signed.statement.evidence {
                Evidence::Verification => "verification, which anybody can repeat".into(),
                Evidence::Document(digest) => format!("a document with SHA-256 {digest}"),
            },
        )],
    }
}

/// A refusal's kind in a word or two.
pub fn refusal(reason: &RefusalCode) -> &'static str {
    match reason {
        RefusalCode::TooLarge { .. } => "too large",
        RefusalCode::Signature => "signature",
        RefusalCode::NotEnrolled(_) => "not enrolled",
        RefusalCode::WrongNetwork { .. } => "other network",
        RefusalCode::WrongRound { .. } => "other round",
        RefusalCode::Late { .. } => "late",
        RefusalCode::Duplicate { .. } => "duplicate",
        RefusalCode::CopiedUpdate { .. } => "copied update",
        RefusalCode::NotCommitted(_) => "not committed",
        RefusalCode::Binding(_) => "claim differs from ledger",
        RefusalCode::Dataset => "dataset",
        RefusalCode::NoDataset(_) => "no dataset",
        RefusalCode::SmallDataset { .. } => "small dataset",
        RefusalCode::NewDataset { .. } => "new dataset",
        RefusalCode::ProofDigest { .. } => "other proof bytes",
        RefusalCode::MalformedProof => "malformed proof",
        RefusalCode::OtherClaim => "proof of another claim",
        RefusalCode::OtherProgram => "proof of another program",
        RefusalCode::InvalidProof => "invalid proof",
        RefusalCode::UpdateDigest { .. } => "other update bytes",
        RefusalCode::MalformedUpdate => "malformed update",
        RefusalCode::OtherWeights { .. } => "other weights than proven",
        RefusalCode::OtherWeightCheck { .. } => "other weight check than proven",
        RefusalCode::OtherModels => "other weights than the argument is about",
        RefusalCode::MissingUpdate(_) => "update missing",
        RefusalCode::NotActive { .. } => "not active",
        RefusalCode::NotInvited { .. } => "not invited",
        RefusalCode::TooFar { .. } => "too far from the base",
        RefusalCode::RoundFull { .. } => "round full",
        RefusalCode::NoVerifier => "no verifier",
        RefusalCode::EvalSamples { .. } => "too few or too many evaluation samples",
        RefusalCode::CommitmentsClosed { .. } => "commitments closed",
        RefusalCode::NoRandomness { .. } => "no randomness yet",
        RefusalCode::Paused { .. } => "paused",
        RefusalCode::UnreadWeights { .. } => "weights that are not evaluated",
    }
}

/// A ledger time, in UTC.
pub fn time(unix_ms: u64) -> String {
    let ms = i64::try_from(unix_ms).ok();
    match ms.and_then(chrono::DateTime::from_timestamp_millis) {
        Some(time) => time.format("%Y-%m-%d %H:%M:%SZ").to_string(),
        None => format!("{unix_ms} ms"),
    }
}

/// Text without control characters, which a terminal would obey. Names and reasons are untrusted.
pub fn printable(text: &str) -> String {
    let shown = |c: char| {
        if c.is_control() {
            c.escape_default().collect::<String>()
        } else {
            c.to_string()
        }
    };
    text.chars().map(shown).collect()
}
