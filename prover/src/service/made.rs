//! Proofs that are there already. A node that was interrupted, or whose connection broke, asks for its proof again with the same bytes. It gets
//! the proof that was made meanwhile, or the one that is being made, so that nobody proves the same claim again.

use super::schedule::QueuePosition;
use crate::program::GuestInput;
use crate::rpc;
use sha2::{Digest, Sha256};
use std::sync::Arc;
use tokio::sync::watch;
use zk0_circuits::Mode;

/// The SHA-256 of everything that decides a proof: the mode, which names the program, and the buffers that the program reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RequestDigest([u8; 32]);

impl RequestDigest {
    /// The digest of a request. A gigabyte takes seconds.
    pub fn of(input: &GuestInput) -> Self {
        let mode = match input.mode {
            Mode::Direct => 1u64,
            Mode::Succinct => 3,
        };
        let mut hasher = Sha256::new();
        hasher.update(mode.to_le_bytes());
        for buffer in &input.buffers {
            // The length comes first, so that bytes cannot move from one buffer to the next.
            hasher.update((buffer.len() as u64).to_le_bytes());
            hasher.update(buffer);
        }
        Self(hasher.finalize().into())
    }
}

/// The proofs of a service that somebody may still ask for: two at most, of 1.3 MB each.
#[derive(Default)]
pub(super) struct Made(watch::Sender<Proofs>);

/// The service cannot know that a client has a proof: it may have gone while the last bytes were on their way. So the newest proof stays in any
/// case until the next one is made, and a proof that was not sent stays besides it.
#[derive(Default)]
struct Proofs {
    making: Option<(RequestDigest, QueuePosition)>,
    newest: Option<MadeProof>,
    untaken: Option<MadeProof>,
}

struct MadeProof {
    of: RequestDigest,
    proof: Arc<rpc::Proof>,
    /// Whether it was sent to a client.
    taken: bool,
}

impl Made {
    /// The proof of this request is being made from now on, at this place of the queue.
    pub fn begins(&self, of: RequestDigest, place: QueuePosition) {
        self.0
            .send_modify(|proofs| proofs.making = Some((of, place)));
    }

    /// No proof is being made any more.
    pub fn ends(&self) {
        self.0.send_modify(|proofs| proofs.making = None);
    }

    /// Keeps a proof. Those who wait for it in [`Self::until`] get it.
    pub fn keep(&self, of: RequestDigest, proof: Arc<rpc::Proof>) {
        self.0.send_modify(|proofs| proofs.keep(of, proof));
    }

    /// The proof of this request was sent to a client.
    pub fn taken(&self, of: RequestDigest) {
        self.0.send_modify(|proofs| {
            let kept = [&mut proofs.newest, &mut proofs.untaken];
            for kept in kept.into_iter().flatten().filter(|kept| kept.of == of) {
                kept.taken = true;
            }
        });
    }

    /// The proof of this request, if it is there.
    pub fn proof(&self, of: RequestDigest) -> Option<Arc<rpc::Proof>> {
        self.0.borrow().proof(of)
    }

    /// Whether the proof of this request is there or is being made.
    pub fn has(&self, of: RequestDigest) -> bool {
        // A proof is kept before its making ends.
        self.making(of).is_some() || self.proof(of).is_some()
    }

    /// The place at which the proof of this request is being made, if it is.
    pub fn making(&self, of: RequestDigest) -> Option<QueuePosition> {
        let (making, place) = self.0.borrow().making?;
        (making == of).then_some(place)
    }

    /// Waits as long as the proof of this request is being made. Then it is there, or it has failed.
    pub async fn ended(&self, of: RequestDigest) {
        let mut changes = self.0.subscribe();
        let ended = |proofs: &Proofs| proofs.making.is_none_or(|(making, _)| making != of);
        // An error says that the service itself is gone.
        let _ = changes.wait_for(ended).await;
    }

    /// The proof of this request, as soon as it is there.
    pub async fn until(&self, of: RequestDigest) -> Arc<rpc::Proof> {
        let mut changes = self.0.subscribe();
        loop {
            if let Some(proof) = self.proof(of) {
                return proof;
            }
            if changes.changed().await.is_err() {
                // The service itself is gone.
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

    /// Keeps proofs of these requests, one after the other. Those that are `true` are taken. Returns which of them are there at the end.
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
        let of = |mode, buffers: &[&str]| {
            let buffers = buffers.iter().map(|buffer| buffer.as_bytes().to_vec());
            let buffers = buffers.collect();
            RequestDigest::of(&GuestInput { mode, buffers })
        };
        let same = of(Mode::Direct, &["ab", "c"]);
        assert_eq!(same, of(Mode::Direct, &["ab", "c"]));
        for other in [
            of(Mode::Succinct, &["ab", "c"]),
            of(Mode::Direct, &["a", "bc"]),
            of(Mode::Direct, &["ab", "c", ""]),
            of(Mode::Direct, &["ab", "d"]),
        ] {
            assert_ne!(same, other);
        }
    }
}
