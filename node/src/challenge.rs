//! Waits for a round's randomness, verifies it, and derives the node's challenge. The node does not trust the aggregator: it demands
//! receipts, and verifies that the randomness is of the source that the rules name.

use crate::client::watching::FollowedRound;
use crate::client::{unexpected, NodeClient};
use crate::client_error::NodeError;
use std::time::{SystemTime, UNIX_EPOCH};
use tracing::instrument;
use zk0_circuits::claim::challenge::challenge;
use zk0_circuits::Digest;
use zk0_protocol::challenge::closing::CommitmentsClosing;
use zk0_protocol::challenge::drawing::DrawContext;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::{Body, RoundOpened};
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;
use zk0_protocol::tlog::receipt::Receipt;

impl NodeClient {
    /// Waits for the randomness of a round in which the node has made this commitment. Returns the challenge, and the receipt of the
    /// randomness.
    ///
    /// # Errors
    /// The round closes without randomness, or the aggregator does not follow the rules.
    #[instrument(name = "wait for the challenge", skip_all)]
    pub async fn wait_for_challenge(
        &mut self,
        opened: &RoundOpened,
        commitment: &Digest,
    ) -> Result<(Digest, Receipt), NodeError> {
        let round = opened.round;
        let mut waited = false;
        let mut closing = None;
        let mut watch = FollowedRound::of(Some(round), Vec::new());
        loop {
            let info = self.next_stage(&mut watch).await?;
            if let (None, Some(receipt)) = (closing, info.commitments_closed) {
                let found = self.closing(round, receipt)?;
                if waited {
                    warn_if_beacon_is_known(opened, &found.0);
                }
                closing = Some(found);
            }
            match (&closing, info.randomness, info.closed) {
                (Some((closing, log_key)), Some(receipt), _) => {
                    let opening = self.opening.filter(|(opened, _)| *opened == round);
                    let key = opening.map_or(*log_key, |(_, key)| key);
                    let drawn = self.randomness(opened, (closing, &key), receipt)?;
                    let (randomness, receipt) = drawn;
                    let (network, node) = (*self.network(), self.id());
                    let challenge = challenge(&network, round, &node, commitment, &randomness);
                    return Ok((challenge, receipt));
                }
                (_, None, Some(_)) => return Err(NodeError::NoRandomness { round }),
                _ => {}
            }
            waited = true;
        }
    }

    /// The closing of the commitments, and the log's key there.
    fn closing(
        &self,
        round: u64,
        receipt: rpc::Receipt,
    ) -> Result<(CommitmentsClosing, [u8; 32]), NodeError> {
        // The randomness, which the newest key vouches for, is of this closing.
        let (receipt, signed, entry) = self.opened_of_size(receipt)?;
        let KeyedCheckpoint {
            checkpoint, key, ..
        } = signed;
        let closed = match entry.body {
            Body::CommitmentsClosed(closed) if closed.round == round => closed,
            _ => {
                return Err(unexpected(
                    "the closing of the round's commitments",
                    "another entry",
                ))
            }
        };
        // The randomness may follow from the cosignatures of the checkpoint that ends with this entry.
        if checkpoint.size != receipt.index + 1 {
            let found = format!("one of size {}", checkpoint.size);
            return Err(unexpected(
                "the checkpoint that ends with the closing of the commitments",
                found,
            ));
        }
        let closing = CommitmentsClosing {
            entry: receipt.index,
            time_ms: entry.time_ms,
            root: checkpoint.root,
            commitments: closed.commitments,
        };
        Ok((closing, key))
    }

    fn randomness(
        &self,
        opened: &RoundOpened,
        (closing, log_key): (&CommitmentsClosing, &[u8; 32]),
        receipt: rpc::Receipt,
    ) -> Result<(Digest, Receipt), NodeError> {
        let round = opened.round;
        let (receipt, _, entry) = self.opened(receipt)?;
        let drawn = match entry.body {
            Body::RandomnessDrawn(drawn) if drawn.round == round => drawn,
            _ => return Err(unexpected("the randomness of the round", "another entry")),
        };
        let context = DrawContext {
            rules: &opened.rules,
            origin: self.genesis().origin(),
            log_key,
            closing,
            recorded_ms: entry.time_ms,
        };
        let verified = drawn.drawing.verify(&context);
        verified.map_err(|error| NodeError::Randomness { round, error })?;
        let value = drawn.drawing.value();
        let value = value.ok_or_else(|| unexpected("randomness", "something else"))?;
        tracing::info!(
            "round {round}: its randomness {value} comes from {}",
            drawn.drawing
        );
        Ok((value, receipt))
    }
}

/// Warns if the beacon was known before the aggregator showed the closing that determines it: then the aggregator could choose among
/// beacons.
fn warn_if_beacon_is_known(opened: &RoundOpened, closing: &CommitmentsClosing) {
    let RandomnessSource::Drand(chain) = &opened.rules.randomness else {
        return;
    };
    let now_ms = SystemTime::now().duration_since(UNIX_EPOCH);
    let now_ms = now_ms.map_or(0, |since| since.as_millis() as u64);
    let beacon = chain.round_after(closing.time_ms);
    if now_ms > chain.time_ms(beacon) {
        tracing::warn!(
            "round {}: the aggregator showed the closing of the commitments {} ms after drand signed the beacon that it determines. \
             If this machine's clock is right and the connection was not interrupted, the aggregator may have chosen the beacon",
            opened.round,
            now_ms - chain.time_ms(beacon)
        );
    }
}
