//! The end of a round. Combining and evaluating take long, so they run away from the aggregator, which records the end if the round has not
//! changed.

use crate::round::accepted::{verify_all, Accepted};
use crate::round::intake::lost_files::ContributedFiles;
use crate::round::ledger_index::still_valid;
use crate::round::request_error::RequestError;
use std::fmt::Display;
use std::io::{sink, Write};
use std::path::PathBuf;
use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::entries::entry::Contributor;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::state::State;
use zk0_verifier::close::{close, CloseError, RoundOutcome};
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::optimizers::moments::has_moments;
use zk0_verifier::{BaseFiles, ResultFiles, VerifiedContribution};

/// A round that may close: what determines its end.
#[derive(Clone, Debug, PartialEq)]
pub struct ToClose {
    /// The state of the ledger.
    pub state: State,
    /// What was accepted.
    pub contributions: Vec<VerifiedContribution>,
    /// Accepted too, but a blob was lost at the start.
    pub lost: Vec<Accepted>,
    /// The files of all accepted contributions.
    pub accepted: Vec<ContributedFiles>,
    /// The blobs of the ledger.
    pub blobs: Blobs,
    /// The ledger's folder.
    pub dir: PathBuf,
}

/// The end of a round, to be recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComputedClosing {
    /// The end.
    pub closing: RoundOutcome,
    /// Whose contributions determine the end.
    pub contributors: Vec<Contributor>,
}

impl ToClose {
    /// The lost files of accepted contributions.
    pub fn lost_files(&self) -> Vec<ContributedFiles> {
        let all = self.accepted.iter().cloned();
        all.filter_map(|files| files.lost(&self.blobs)).collect()
    }

    /// Computes the end, and keeps the new weights. If a file is missing or damaged, returns why the round cannot close now.
    pub fn compute(self) -> Result<Result<ComputedClosing, String>, RequestError> {
        let Self {
            state,
            mut contributions,
            lost,
            blobs,
            dir,
            ..
        } = self;
        let get = |digest: &Digest, limit| blobs.get(digest, limit);
        let blocked = |what: &str, why: &dyn Display| {
            let place = match blobs.store_address() {
                None => format!("put the file back among the blobs in {}", dir.display()),
                Some(address) => format!("the blob store {address} has to give the file back"),
            };
            Ok(Err(format!(
                "the open round cannot close, because {what}: {why}; {place}"
            )))
        };
        for (accepted, verdict) in lost.iter().zip(verify_all(&lost, &blobs)) {
            match verdict {
                Ok(verified) => contributions.push(still_valid(accepted, verified)?),
                Err(unreadable) => {
                    let what = format!("a file of node {} is lost", accepted.node());
                    return blocked(&what, &unreadable);
                }
            }
        }
        // The rules ask for these files, so the round waits for them.
        let bases = match BaseFiles::read(&state, get) {
            Ok(bases) => bases,
            Err(unreadable) => return blocked("its updates cannot be combined", &unreadable),
        };
        let files = match ResultFiles::read(&state, get) {
            Ok(files) => files,
            Err(unreadable) => return blocked("its result cannot be evaluated", &unreadable),
        };
        let read_at =
            |digest: &Digest, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
        // The round waits for the disk, and for the store.
        let not_kept = |why: &dyn Display| {
            Ok(Err(format!(
                "the open round cannot close, because its result cannot be kept: {why}"
            )))
        };
        let mut moments = if has_moments(&state) && !contributions.is_empty() {
            match blobs.writer(BlobKind::Moments.max_bytes(state.rules())) {
                Ok(writer) => Some(writer),
                Err(error) => return not_kept(&error),
            }
        } else {
            None
        };
        let mut nowhere = sink();
        let kept: &mut dyn Write = match &mut moments {
            Some(writer) => writer,
            None => &mut nowhere,
        };
        let closing = match close(
            &state,
            &contributions,
            &bases,
            read_at,
            kept,
            files.as_ref(),
        ) {
            Err(CloseError::Combine(
                lost @ (CombineError::Unreadable { .. }
                | CombineError::Changed { .. }
                | CombineError::MomentsUnreadable { .. }
                | CombineError::OtherMoments { .. }),
            )) => return blocked("its updates cannot be combined", &lost),
            Err(CloseError::Combine(unwritten @ CombineError::MomentsUnwritten(_))) => {
                return not_kept(&unwritten)
            }
            closing => closing?,
        };
        let moments = match (moments, &closing.moments) {
            (Some(writer), Some(digest)) => writer.finish(digest),
            _ => Ok(()),
        };
        let kept = moments.and_then(|()| match &closing.file {
            Some(file) => blobs.put(file).map(drop),
            None => Ok(()),
        });
        match kept {
            Err(failed @ (BlobError::Store(_) | BlobError::Io { .. })) => return not_kept(&failed),
            kept => kept?,
        }
        Ok(Ok(ComputedClosing {
            closing,
            contributors: state.contributors(),
        }))
    }
}
