//! Why a request to the aggregator fails.

use tonic::Status;
use zk0_circuits::Digest;
use zk0_protocol::challenge::drawing::RandomnessError;
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::rpc::federation::TurnedDown;
use zk0_protocol::tlog::checkpoint::CheckpointError;
use zk0_protocol::tlog::receipt::ReceiptError;
use zk0_protocol::RefusalCode;
use zk0_tls::service_address::ConnectError;

/// What goes wrong between a node and its aggregator.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// There is no connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The aggregator refuses, and gives the reason.
    #[error("{}", .0.message())]
    Refused(Box<Status>),
    /// The aggregator serves another network.
    #[error("the aggregator serves network {theirs}, not network {ours}")]
    OtherNetwork {
        /// The network that the node was told.
        ours: Digest,
        /// The network whose genesis the aggregator sent.
        theirs: Digest,
    },
    /// It sent bytes that are not an entry of a ledger.
    #[error("the aggregator sent a broken entry: {0}")]
    Entry(#[from] EntryError),
    /// It sent a checkpoint that the log did not sign.
    #[error("{0}")]
    Checkpoint(#[from] CheckpointError),
    /// It sent a receipt that does not prove the entry.
    #[error("{0}")]
    Receipt(#[from] ReceiptError),
    /// It answered with something other than what the node asked for.
    #[error("the aggregator answered with {found}; the node asked for {expected}")]
    Unexpected {
        /// What the node asked for.
        expected: String,
        /// What came.
        found: String,
    },
    /// The round closed without randomness, so there was no challenge.
    #[error("round {round} closed without randomness, so nobody could make a claim in it")]
    NoRandomness {
        /// The round.
        round: u64,
    },
    /// The randomness of the round does not come from the source that the rules name.
    #[error("the randomness of round {round} is wrong, so the node makes no claim: {error}")]
    Randomness {
        /// The round.
        round: u64,
        /// What is wrong with it.
        error: RandomnessError,
    },
    /// It sent another blob than the node asked for.
    #[error("blob {asked} has SHA-256 {actual} as the aggregator sent it")]
    OtherBlob {
        /// The blob that the node asked for.
        asked: Digest,
        /// The SHA-256 of what it received.
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
    /// The update cannot be put into the aggregator's store.
    #[error("{0}")]
    Store(String),
    /// What was downloaded cannot be written to disk.
    #[error("a download cannot be written to disk: {0}")]
    Write(std::io::Error),
    /// There is no nonce for the head of a request.
    #[error("the system gives no random bytes: {0}")]
    Random(getrandom::Error),
    /// The new key of a node is its present one.
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
