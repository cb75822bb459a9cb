//! Why a request to the aggregator fails.

use std::path::PathBuf;
use tonic::Status;
use zk0_circuits::Digest;
use zk0_protocol::challenge::drawing::RandomnessError;
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::rpc::federation::TurnedDown;
use zk0_protocol::rpc::PROTOCOL;
use zk0_protocol::tlog::checkpoint::CheckpointError;
use zk0_protocol::tlog::receipt::ReceiptError;
use zk0_protocol::RefusalCode;
use zk0_service::tls::service_address::ConnectError;

/// Why a request to the aggregator fails.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// There is no connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The aggregator refuses.
    #[error("{}", .0.message())]
    Refused(Box<Status>),
    /// The aggregator speaks another protocol. The text is its own, shortened.
    #[error(
        "the aggregator speaks protocol {theirs}, and this program speaks protocol {ours}. The aggregator states: {release:?}. Install that release of zk0",
        ours = PROTOCOL
    )]
    OtherProtocol {
        /// The aggregator's protocol.
        theirs: u32,
        /// Its sentence for people.
        release: String,
    },
    /// The aggregator serves another network.
    #[error("the aggregator serves network {theirs}, not network {ours}")]
    OtherNetwork {
        /// The network that the node joined.
        ours: Digest,
        /// The network of the aggregator's genesis.
        theirs: Digest,
    },
    /// It sent bytes that are no entry.
    #[error("the aggregator sent a broken entry: {0}")]
    Entry(#[from] EntryError),
    /// It sent a checkpoint that the log did not sign.
    #[error("{0}")]
    Checkpoint(#[from] CheckpointError),
    /// It sent a checkpoint that a former key of the log signed.
    #[error("the aggregator's checkpoint of {size} entries is signed with a former key of the log, which may be stolen: entry {since} gave the log another one. Ask the network's operator for the aggregator's address")]
    FormerKey {
        /// The checkpoint's entries.
        size: u64,
        /// The entry that gave the log its newest key.
        since: u64,
    },
    /// The file that names the log's newest key cannot be read or written.
    #[error("{path}: {why}. The node keeps there which key of the log it has seen, to know a thief who has a former one. Put the file back, or remove it if no former key of the log was stolen")]
    SeenKey {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// It sent a receipt that does not prove the entry.
    #[error("{0}")]
    Receipt(#[from] ReceiptError),
    /// The answer does not fit the request.
    #[error("the aggregator answered with {found}; the node asked for {expected}")]
    Unexpected {
        /// What was asked for.
        expected: String,
        /// What came.
        found: String,
    },
    /// The round closed without randomness.
    #[error("round {round} closed without randomness, so nobody could make a claim in it")]
    NoRandomness {
        /// The round.
        round: u64,
    },
    /// The randomness is wrong.
    #[error("the randomness of round {round} is wrong, so the node makes no claim: {error}")]
    Randomness {
        /// The round.
        round: u64,
        /// What is wrong.
        error: RandomnessError,
    },
    /// It sent another blob.
    #[error("blob {asked} has SHA-256 {actual} as the aggregator sent it")]
    OtherBlob {
        /// The blob asked for.
        asked: Digest,
        /// SHA-256 of the other.
        actual: Digest,
    },
    /// It sent a blob over the limit.
    #[error("blob {blob} is longer than {limit} bytes, which is the limit for it")]
    TooLarge {
        /// The blob.
        blob: Digest,
        /// The limit.
        limit: u64,
    },
    /// The aggregator's store does not take the update.
    #[error("{0}")]
    Store(String),
    /// A download cannot be written to disk.
    #[error("a download cannot be written to disk: {0}")]
    Write(std::io::Error),
    /// There is no nonce for a request.
    #[error("the system gives no random bytes: {0}")]
    Random(getrandom::Error),
    /// The new key is the present one.
    #[error("the new key is the present one: make another with `zk0 node keygen`")]
    SameKey,
}

impl From<Status> for NodeError {
    fn from(status: Status) -> Self {
        Self::Refused(Box::new(status))
    }
}

impl NodeError {
    /// Whether the aggregator lacks the update that the node commits to.
    pub fn lacks_update(&self) -> bool {
        let missing = RefusalCode::MissingUpdate(Digest([0; 32])).number();
        match self {
            Self::Refused(status) => TurnedDown::of(status).code == u32::from(missing),
            _ => false,
        }
    }
}
