//! The checks of a round's end: average and evaluation.

use crate::account::{CheckKind, SkipReason};
use crate::checks::check::{get, not_at_hand, unreadable, Check};
use crate::checks::pruning_waiver::PruningWaiver;
use crate::depth::Depth;
use std::io::sink;
use zk0_circuits::{Digest, WeightsDigest};
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::entries::entry::RoundClosed;
use zk0_protocol::entries::round_result::EvaluatedResult;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::state::State;
use zk0_verifier::close::{combined, end, CloseError};
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::optimizers::moments::needed;
use zk0_verifier::combine::strategy::Global;
use zk0_verifier::{BaseFiles, ResultFiles, Unreadable, VerifiedContribution};

/// Checks that the accepted contributions combine to the recorded result.
pub fn average(
    before: &State,
    closed: &RoundClosed,
    contributions: &[VerifiedContribution],
    depth: Depth,
    waiver: PruningWaiver,
    blobs: &Blobs,
) -> Result<Option<Global>, Check> {
    let what = || format!("the average of round {}", closed.round);
    if depth == Depth::Light && !before.contributors().is_empty() {
        return Err(Check::LeftOut(
            CheckKind::Averages,
            SkipReason::Light,
            what(),
        ));
    }
    if contributions.len() != before.contributors().len() {
        let why = format!("{}, because not all of its updates were verified", what());
        return Err(Check::LeftOut(
            CheckKind::Averages,
            SkipReason::RestsOnOthers,
            why,
        ));
    }
    let evaluated = closed.evaluated.as_ref();
    let recorded = evaluated.map_or(closed.global, |evaluated| evaluated.weights);
    let get = |digest: &Digest, limit| get(blobs, digest, limit);
    let bases = match BaseFiles::read(before, get) {
        Ok(bases) => bases,
        Err(Unreadable {
            kind,
            error: BlobError::Missing(blob),
        }) => {
            let why = format!(
                "{}: the base weights {blob} that the strategy reads",
                what()
            );
            return Err(not_at_hand(
                CheckKind::Averages,
                blob,
                why,
                waiver.why(&kind),
            ));
        }
        Err(error) => {
            let why = format!("{}: {error}", what());
            return Err(unreadable(&error.error, why));
        }
    };
    let lost = needed(before).filter(|moments| !blobs.contains(&moments.blob));
    if let Some(lost) = lost.filter(|_| !contributions.is_empty()) {
        let why = format!(
            "{}: the moments {} that the strategy goes on from",
            what(),
            lost.blob
        );
        let why_not = waiver.why(&BlobKind::Moments);
        return Err(not_at_hand(CheckKind::Averages, lost.blob, why, why_not));
    }
    let read_at = |digest: &Digest, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
    let named = before.round().and_then(|round| round.moments);
    match combined(before, contributions, &bases, read_at, &mut sink()) {
        Ok(Some(global)) if global.digest != recorded => Err(Check::Failed(format!(
            "round {} closed with the result {}, but its contributions give {}",
            closed.round,
            show(&recorded),
            show(&global.digest)
        ))),
        Ok(Some(global)) if closed.is_taken() && global.moments != named => {
            let show =
                |moments: Option<Digest>| moments.map_or("none".into(), |one| one.to_string());
            Err(Check::Failed(format!(
                "round {} closed with the moments {}, but its contributions give {}",
                closed.round,
                show(named),
                show(global.moments)
            )))
        }
        Ok(global) => Ok(global),
        Err(error) => Err(cannot_combine(closed, &error, blobs)),
    }
}

/// Checks that a round's result, `combined`, has the recorded losses on the public samples, and was rightly taken or not. `None` if the
/// rules ask for no evaluation.
pub fn result(
    before: &State,
    closed: &RoundClosed,
    combined: Result<Option<Global>, ()>,
    depth: Depth,
    waiver: PruningWaiver,
    blobs: &Blobs,
) -> Option<Check> {
    let recorded = closed.evaluated.as_ref()?;
    let what = format!("the evaluation of round {}'s result", closed.round);
    if depth == Depth::Light {
        return Some(Check::LeftOut(CheckKind::Results, SkipReason::Light, what));
    }
    let Ok(combined) = combined else {
        let why = format!("{what}, because the average was not verified");
        return Some(Check::LeftOut(
            CheckKind::Results,
            SkipReason::RestsOnOthers,
            why,
        ));
    };
    let get = |digest: &Digest, limit| get(blobs, digest, limit);
    let files = match ResultFiles::read(before, get) {
        Ok(files) => files,
        Err(Unreadable {
            kind,
            error: BlobError::Missing(blob),
        }) => {
            let name = match kind {
                BlobKind::PublicSamples => "the file of public samples",
                _ => "the base weights",
            };
            let why = format!("{what}: {name} {blob}");
            return Some(not_at_hand(
                CheckKind::Results,
                blob,
                why,
                waiver.why(&kind),
            ));
        }
        Err(error) => {
            let why = format!("{what}: {error}");
            return Some(unreadable(&error.error, why));
        }
    };
    Some(match end(before, combined, files.as_ref()) {
        Ok(closing) if closing.closed == *closed => Check::Passed(CheckKind::Results),
        Ok(closing) => {
            let found = closing.closed.evaluated.as_ref().map(evaluation_in_words);
            Check::Failed(format!(
                "round {} closed with {}, but its result has {}",
                closed.round,
                evaluation_in_words(recorded),
                found.unwrap_or_else(|| "no evaluation".into())
            ))
        }
        Err(error) => cannot_close(closed, &error),
    })
}

fn evaluation_in_words(evaluated: &EvaluatedResult) -> String {
    format!(
        "{} for the base and {} for the result over {} elements ({})",
        evaluated.base, evaluated.result, evaluated.elements, evaluated.outcome
    )
}

fn cannot_close(closed: &RoundClosed, error: &CloseError) -> Check {
    Check::Failed(how_not_closed(closed, error))
}

/// A round's contributions do not combine. A file that is the reason shows whether it is damaged.
fn cannot_combine(closed: &RoundClosed, error: &CloseError, blobs: &Blobs) -> Check {
    let text = how_not_closed(closed, error);
    match error {
        // The update was verified. If its file is whole, the disk returned other bytes.
        CloseError::Combine(
            CombineError::Unreadable { blob, .. } | CombineError::Changed { blob, .. },
        ) => match blobs.check(blob) {
            Ok(()) => Check::Unread(text),
            Err(error) => unreadable(&error, text),
        },
        // The moments were not verified. If their file is whole, the ledger names a file without moments.
        CloseError::Combine(
            CombineError::MomentsUnreadable { blob, .. }
            | CombineError::OtherMoments { expected: blob, .. },
        ) => match blobs.check(blob) {
            Ok(()) => Check::Failed(text),
            Err(error) => unreadable(&error, text),
        },
        _ => Check::Failed(text),
    }
}

fn how_not_closed(closed: &RoundClosed, error: &CloseError) -> String {
    format!("round {} cannot have closed: {error}", closed.round)
}

fn show(weights: &WeightsDigest) -> String {
    format!("{} (quantised {})", weights.blob, weights.quantised)
}
