//! A poisoned average does not become the base: the result of a round is evaluated on the network's public samples before it is taken.
//! Whatever the aggregator records of that, an audit computes again.
//!
//! The contributions have no proofs here. What is tested comes after the proofs: accepted updates, and what they combine to.

use tempfile::TempDir;
use zk0_audit::account::{CheckKind, SkipReason};
use zk0_audit::checks::closings::result;
use zk0_audit::checks::pruning_waiver::PruningWaiver;
use zk0_audit::checks::Check;
use zk0_audit::report::history::History;
use zk0_audit::report::html::page;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::Depth;
use zk0_circuits::EvalSpec;
use zk0_protocol::entries::entry::{Body, RoundClosed};
use zk0_protocol::entries::round_result::{PublicLoss, ResultOutcome};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::samples::{public_samples, rule_of};
use zk0_testkit::aggregator::*;
use zk0_verifier::close::{end, CloseError, RoundOutcome};
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::optimizers::moments::Moments;
use zk0_verifier::combine::source::WeightsInMemory;
use zk0_verifier::combine::strategy::{combined, Global};
use zk0_verifier::result::ResultError;
use zk0_verifier::ResultFiles;
use zk0_weights::scale::{exact, narrowed};
use zk0_weights::{Format, Unread, WeightFileError};

/// Expert weights like [`weights`], in which the tensors whose names begin with `prefix` are multiplied by `factor`.
fn scaled(seed: u32, prefix: &str, factor: f64) -> Vec<u8> {
    let format = format();
    let read = format.read(&weights(seed)).unwrap();
    let scaled = format.assemble(|tensor| {
        let factor = match format.tensors()[tensor].name.starts_with(prefix) {
            true => factor,
            false => 1.0,
        };
        let (values, bits) = format.tensor(&read, tensor);
        let values = values.iter().map(|value| exact(*value, bits) as f64);
        let values: Vec<_> = values.map(|value| (value * factor) as i128).collect();
        Ok::<_, WeightFileError>(narrowed(&values, 1, format.limits()[tensor]))
    });
    format.write(&scaled.unwrap())
}

fn format() -> Format {
    Format::new(&EvalSpec::micro()).unwrap()
}

/// A network with public samples, whose open round has accepted an update of each node.
struct Accepted {
    dir: TempDir,
    operator: Operator,
    /// What the updates combine to.
    combined: Global,
}

impl Accepted {
    fn of(base: &[u8], updates: [&[u8]; 2]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let samples = public_samples();
        let mut founded = genesis();
        founded.initial = digest(base);
        founded.rules.public_samples = Some(rule_of(&samples));
        let nodes = [SigningNode::new(1), SigningNode::new(2)];
        let mut operator = Operator::founds(dir.path(), founded, &[&nodes[0], &nodes[1]]);
        for blob in [base, &samples] {
            operator.ledger.blobs().put(blob).unwrap();
        }
        operator.open();
        let mut submissions = Vec::new();
        for (node, update) in nodes.iter().zip(updates) {
            operator.commit(node, update);
        }
        operator.draw();
        for (node, update) in nodes.iter().zip(updates) {
            submissions.push(operator.submission_of(node, update, &node.seed.to_le_bytes()[..1]));
        }
        for submission in submissions {
            operator.append(Body::ContributionAccepted(submission));
        }
        let format = format();
        let read = updates.map(|update| format.read(update).unwrap());
        let read = read.each_ref().map(|weights| WeightsInMemory {
            format: &format,
            weights,
        });
        let given: Vec<_> = nodes
            .iter()
            .zip(&read)
            .map(|(node, weights)| WeightedContribution {
                node: node.id(),
                weight: 10_000,
                weights,
            })
            .collect();
        let unread = Unread::of(&format, &format.open(base).unwrap()).unwrap();
        let bases = Bases::default();
        let mut nowhere = std::io::sink();
        let moments = &mut Moments::afresh(&mut nowhere);
        let strategy = Strategy::FedAvg;
        let combined = combined(&format, &given, strategy, &bases, &unread, moments).unwrap();
        let file = combined.file.into_bytes();
        let combined = Global {
            digest: digest(&file),
            file,
            moments: None,
        };
        Self {
            dir,
            operator,
            combined,
        }
    }

    fn files(&self) -> Option<ResultFiles> {
        let get = |digest: &_, limit| self.operator.ledger.blobs().get(digest, limit);
        ResultFiles::read(self.operator.state(), get).unwrap()
    }

    fn end(&self) -> RoundOutcome {
        let files = self.files();
        end(
            self.operator.state(),
            Some(self.combined.clone()),
            files.as_ref(),
        )
        .unwrap()
    }

    /// What an audit states of a closing.
    fn audited(&self, closed: &RoundClosed, depth: Depth) -> Check {
        let combined = Ok(Some(self.combined.clone()));
        let (state, blobs) = (self.operator.state(), self.operator.ledger.blobs());
        result(
            state,
            closed,
            combined,
            depth,
            PruningWaiver::default(),
            blobs,
        )
        .unwrap()
    }

    /// Records the closing, and opens the next round.
    fn go_on(&mut self, closed: RoundClosed) {
        self.operator.append(Body::RoundClosed(closed));
        self.operator.open();
    }
}

fn outcome(closing: &RoundOutcome) -> ResultOutcome {
    closing.closed.evaluated.as_ref().unwrap().outcome
}

#[test]
fn a_poisoned_average_does_not_become_the_base() {
    let base = weights(0);
    // Either update was accepted. The average overflows, or its velocity is far too large.
    for (poison, expected) in [
        (scaled(2, "", 3000.0), ResultOutcome::Overflow),
        (
            scaled(2, "model.action_out_proj", 100.0),
            ResultOutcome::Worse,
        ),
    ] {
        let mut accepted = Accepted::of(&base, [&weights(1), &poison]);
        let closing = accepted.end();
        assert_eq!(
            outcome(&closing),
            expected,
            "{:?}",
            closing.closed.evaluated
        );
        assert_eq!(closing.file, None);
        let closed = closing.closed;
        assert_eq!(closed.global, digest(&base));
        assert_eq!(closed.contributors.len(), 2);
        assert!(closed.contributors.iter().all(|one| one.credits == 0));
        assert!(matches!(
            accepted.audited(&closed, Depth::Full),
            Check::Passed(CheckKind::Results)
        ));
        accepted.go_on(closed);
        let round = accepted.operator.state().round().unwrap();
        assert_eq!(round.opened.base, digest(&base));
    }
}

#[test]
fn a_good_average_becomes_the_base() {
    let calmer = |factor| scaled(0, "model.action_out_proj", factor);
    let mut accepted = Accepted::of(&weights(0), [&calmer(0.1), &calmer(0.2)]);
    let closing = accepted.end();
    assert_eq!(outcome(&closing), ResultOutcome::Taken);
    assert_eq!(closing.file.as_ref(), Some(&accepted.combined.file));
    assert!(closing
        .closed
        .contributors
        .iter()
        .all(|one| one.credits > 0));
    let (result, closed) = (accepted.combined.digest, closing.closed);
    assert_eq!(closed.global, result);
    assert!(matches!(
        accepted.audited(&closed, Depth::Full),
        Check::Passed(CheckKind::Results)
    ));
    accepted.go_on(closed);
    assert_eq!(
        accepted.operator.state().round().unwrap().opened.base,
        result
    );
}

#[test]
fn a_result_that_does_not_overflow_is_an_improvement_on_a_base_that_does() {
    let poisoned = scaled(0, "", 3000.0);
    let accepted = Accepted::of(&poisoned, [&weights(1), &weights(2)]);
    let closing = accepted.end();
    let evaluated = closing.closed.evaluated.as_ref().unwrap();
    assert!(matches!(evaluated.base, PublicLoss::Overflow { .. }));
    assert_eq!(evaluated.outcome, ResultOutcome::Taken);
    assert_eq!(closing.closed.global, accepted.combined.digest);
}

#[test]
fn an_audit_finds_losses_and_outcomes_that_are_false() {
    let poison = scaled(2, "model.action_out_proj", 100.0);
    let accepted = Accepted::of(&weights(0), [&weights(1), &poison]);
    let closed = accepted.end().closed;
    // The aggregator wants the poisoned result, so it records a loss with which the rules let it be taken.
    let mut false_loss = closed.clone();
    let evaluated = false_loss.evaluated.as_mut().unwrap();
    evaluated.result = evaluated.base.clone();
    evaluated.outcome = ResultOutcome::Taken;
    false_loss.global = accepted.combined.digest;
    false_loss.contributors = accepted.operator.state().contributors();
    let body = Body::RoundClosed(false_loss.clone());
    let entry = zk0_protocol::Entry {
        version: zk0_protocol::entries::entry::ENTRY_VERSION,
        time_ms: accepted.operator.time_ms,
        body,
    };
    accepted
        .operator
        .state()
        .check(&entry)
        .expect("the ledger alone cannot see it");
    let Check::Failed(why) = accepted.audited(&false_loss, Depth::Full) else {
        panic!("not found");
    };
    assert!(why.contains("the result was not taken"), "{why}");
    let mut false_elements = closed.clone();
    false_elements.evaluated.as_mut().unwrap().elements += 1;
    let found = accepted.audited(&false_elements, Depth::Full);
    assert!(matches!(found, Check::Failed(_)));

    // What cannot be checked is not called verified.
    let left_out = |check| match check {
        Check::LeftOut(CheckKind::Results, why, _) => why,
        Check::NotAtHand(CheckKind::Results, ..) => SkipReason::NotAtHand,
        other => panic!("{other:?}"),
    };
    assert_eq!(
        left_out(accepted.audited(&closed, Depth::Light)),
        SkipReason::Light
    );
    let samples = accepted
        .operator
        .state()
        .rules()
        .public_samples
        .unwrap()
        .blob;
    let path = accepted.operator.ledger.blobs().path(&samples);
    std::fs::write(&path, b"something else").unwrap();
    let found = accepted.audited(&closed, Depth::Full);
    assert!(matches!(found, Check::Damaged(blob, _) if blob == samples));
    std::fs::remove_file(path).unwrap();
    assert_eq!(
        left_out(accepted.audited(&closed, Depth::Full)),
        SkipReason::NotAtHand
    );
}

#[test]
fn a_round_cannot_close_without_the_evaluation() {
    let accepted = Accepted::of(&weights(0), [&weights(1), &weights(2)]);
    let state = accepted.operator.state();
    let samples = state.rules().public_samples.unwrap().blob;
    let error = end(state, Some(accepted.combined.clone()), None).unwrap_err();
    assert_eq!(error, CloseError::Result(ResultError::NotGiven(samples)));
    let mut files = accepted.files().unwrap();
    files.samples.pop();
    let error = end(state, Some(accepted.combined.clone()), Some(&files)).unwrap_err();
    assert!(
        error.to_string().contains("this file has SHA-256"),
        "{error}"
    );
}

#[test]
fn the_report_draws_the_losses_of_each_round() {
    let poison = scaled(2, "model.action_out_proj", 100.0);
    let mut accepted = Accepted::of(&weights(0), [&weights(1), &poison]);
    let closed = accepted.end().closed;
    let bits = EvalSpec::micro().action;
    let (base, result) = closed.evaluated.as_ref().unwrap().means(bits);
    accepted.go_on(closed);
    let (_, audited) = verified_entries(accepted.dir.path()).unwrap();
    let mut history = History::default();
    let ledger = &accepted.operator.ledger;
    for index in 0..ledger.size() {
        history.observe(index, &ledger.entry(index).unwrap());
    }
    let public = history.rounds[0].public.as_ref().unwrap();
    assert_eq!((public.base, public.result), (base, result));
    assert!(!public.taken && base < result);
    let data = serde_json::to_value(&history).unwrap();
    assert_eq!(data["rounds"][0]["public"]["taken"], false);
    assert!(data["rounds"][1]["public"].is_null());
    let page = page(&audited, &history, &[]);
    assert!(page.contains("not taken: worse"));
    assert!(page.contains(
        "Loss of each round&#39;s base and of its result on the network&#39;s public samples"
    ));
}
