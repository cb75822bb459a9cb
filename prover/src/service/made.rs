//! Existing proofs. A node that repeats its request gets the proof made meanwhile or waits for the one in progress: a claim is proven once.

use super::schedule::QueuePosition;
use crate::program::GuestInput;
use crate::rpc;
use sha2::{Digest, Sha256};
use std::sync::Arc;
use tokio::sync::watch;
use zk0_circuits::Mode;

/// The SHA-256 of all that decides a proof: mode, program and buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RequestDigest([u8; 32]);

impl RequestDigest {
    /// A gigabyte takes seconds.
    pub fn of(input: &GuestInput) -> Self {
        let mode = match input.mode {
            Mode::Direct => 1u64,
            Mode::Succinct => 3,
        };
        let mut hasher = Sha256::new();
        hasher.update(mode.to_le_bytes());
        for part in [&input.program].into_iter().chain(&input.buffers) {
            // The length comes first, so that bytes cannot move between parts.
            hasher.update((part.len() as u64).to_le_bytes());
            hasher.update(part);
        }
        Self(hasher.finalize().into())
    }
}

/// Proofs that a client may still ask for: at most two, of 1.3 MB each.
#[derive(Default)]
pub(super) struct Made(watch::Sender<Proofs>);

/// A client may not have a proof that was sent: the last bytes may be lost. So the newest proof stays until the next one, and a proof not
/// sent stays beside it.
#[derive(Default)]
struct Proofs {
    making: Option<(RequestDigest, QueuePosition)>,
    newest: Option<MadeProof>,
    untaken: Option<MadeProof>,
}

struct MadeProof {
    of: RequestDigest,
    proof: Arc<rpc::Proof>,
    taken: bool,
}

impl Made {
    pub fn begins(&self, of: RequestDigest, place: QueuePosition) {
        self.0
            .send_modify(|proofs| proofs.making = Some((of, place)));
    }

    pub fn ends(&self) {
        self.0.send_modify(|proofs| proofs.making = None);
    }

    /// Keeps a proof, and gives it to those who wait in [`Self::until`].
    pub fn keep(&self, of: RequestDigest, proof: Arc<rpc::Proof>) {
        self.0.send_modify(|proofs| proofs.keep(of, proof));
    }

    pub fn taken(&self, of: RequestDigest) {
        self.0.send_modify(|proofs| {
            let kept = [&mut proofs.newest, &mut proofs.untaken];
            for kept in kept.into_iter().flatten().filter(|kept| kept.of == of) {
                kept.taken = true;
            }
        });
    }

    pub fn proof(&self, of: RequestDigest) -> Option<Arc<rpc::Proof>> {
        self.0.borrow().proof(of)
    }

    /// Whether this request's proof is present or in progress.
    pub fn has(&self, of: RequestDigest) -> bool {
        // A proof is kept before its work ends.
        self.making(of).is_some() || self.proof(of).is_some()
    }

    /// The place of this request's proof in progress, if any.
    pub fn making(&self, of: RequestDigest) -> Option<QueuePosition> {
        let (making, place) = self.0.borrow().making?;
        (making == of).then_some(place)
    }

    /// Waits until this request's proof is no longer in progress.
    pub async fn ended(&self, of: RequestDigest) {
        let mut changes = self.0.subscribe();
        let ended = |proofs: &Proofs| proofs.making.is_none_or(|(making, _)| making != of);
        // An error means that the service is gone.
        let _ = changes.wait_for(ended).await;
    }

    pub async fn until(&self, of: RequestDigest) -> Arc<rpc::Proof> {
        let mut changes = self.0.subscribe();
        loop {
            if let Some(proof) = self.proof(of) {
                return proof;
            }
            if changes.changed().await.is_err() {
                // The service is gone.
                std::future::pending::<()>().await;
            }
        }
    }
}

impl Proofs {
    fn keep(&mut self, of: RequestDigest, proof: Arc<rpc::Proof>) {
        let before = [self.newest.take(), self.untaken.take()];
        let mut untaken = before.into_iter().flatten().filter(|kept| !kept.taken);
        self.untaken = untaken.next();
        self.newest = Some(MadeProof {
            of,
            proof,
            taken: false,
        });
    }

    fn proof(&self, of: RequestDigest) -> Option<Arc<rpc::Proof>> {
        let mut kept = [&self.newest, &self.untaken].into_iter().flatten();
        let kept = kept.find(|kept| kept.of == of)?;
        Some(kept.proof.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(name: u8) -> RequestDigest {
        RequestDigest([name; 32])
    }

    /// Keeps these requests' proofs in order; `true` marks a taken one. Returns those left.
    fn kept(proofs: &[(u8, bool)]) -> Vec<u8> {
        let made = Made::default();
        for (name, taken) in proofs {
            made.keep(request(*name), Arc::default());
            if *taken {
                made.taken(request(*name));
            }
        }
        let names = proofs.iter().map(|(name, _)| *name);
        names
            .filter(|name| made.proof(request(*name)).is_some())
            .collect()
    }

    #[test]
    fn the_newest_proof_is_kept_and_the_last_one_that_nobody_took() {
        assert_eq!(kept(&[(1, true)]), [1]);
        assert_eq!(kept(&[(1, true), (2, true)]), [2]);
        assert_eq!(kept(&[(1, false), (2, true), (3, true)]), [1, 3]);
        assert_eq!(kept(&[(1, false), (2, false), (3, true)]), [2, 3]);
        assert_eq!(kept(&[(1, false), (2, false), (3, false)]), [2, 3]);
    }

    #[test]
    fn a_kept_proof_that_is_taken_makes_room() {
        let made = Made::default();
        made.keep(request(1), Arc::default());
        made.keep(request(2), Arc::default());
        made.taken(request(1));
        assert!(made.proof(request(1)).is_some());
        made.keep(request(3), Arc::default());
        assert!(made.proof(request(1)).is_none());
        assert!(made.proof(request(2)).is_some());
    }

    #[test]
    fn every_byte_and_every_border_of_a_request_counts() {
        let input = |mode, buffers: &[&str]| {
            let buffers = buffers.iter().map(|buffer| buffer.as_bytes().to_vec());
            GuestInput::new(mode, buffers.collect())
        };
        let of = |mode, buffers: &[&str]| RequestDigest::of(&input(mode, buffers));
        let of_other_program = GuestInput {
            program: vec![2; 32],
            ..input(Mode::Direct, &["ab", "c"])
        };
        let same = of(Mode::Direct, &["ab", "c"]);
        assert_eq!(same, of(Mode::Direct, &["ab", "c"]));
        for other in [
            of(Mode::Succinct, &["ab", "c"]),
            RequestDigest::of(&of_other_program),
            of(Mode::Direct, &["a", "bc"]),
            of(Mode::Direct, &["ab", "c", ""]),
            of(Mode::Direct, &["ab", "d"]),
        ] {
            assert_ne!(same, other);
        }
    }
}
