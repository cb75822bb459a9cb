//! The signed head of a request: sender, time and message. Requests that change something have one, and requests by which a node
//! shows its presence or gets more room than a stranger.
//!
//! A statement on the ledger is public, so its signature does not identify the sender. A head counts once, for one message, at
//! one aggregator, within minutes. Its readers cannot use it for another message, a second time, or after the aggregator
//! restarts.

use crate::entries::signed::{SignableStatement, SignatureError, Signed};
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::{Digest, NodeId};

/// The most bytes of an encoded head.
pub const MAX_HEAD_BYTES: usize = 512;

/// The methods with heads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, BorshSerialize, BorshDeserialize)]
pub enum Method {
    /// `Submit`.
    Submit,
    /// `Upload`.
    Upload,
    /// `Record`.
    Record,
    /// `WatchRound`, by a node that shows its presence.
    WatchRound,
    /// `Download`, by a node, which has more room than strangers.
    Download,
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// The head of one request.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RequestHead {
    /// The network.
    pub network: Digest,
    /// The aggregator's run: 16 random bytes from its start, in `GetNetwork`.
    pub run: [u8; 16],
    /// The method.
    pub method: Method,
    /// The request's round, if any.
    pub round: Option<u64>,
    /// SHA-256 of the request's signed statement, which names the digests of the rest: a list of drawn frames, an update, a
    /// proof. Without a statement, SHA-256 of the field `node` of `WatchRound`, or `blob` of `Download`.
    pub body: Digest,
    /// The sender.
    pub sender: NodeId,
    /// When the sender signed, in Unix milliseconds.
    pub time_ms: u64,
    /// Random bytes, used once.
    pub nonce: [u8; 16],
}

impl SignableStatement for RequestHead {
    const TAG: &'static str = "zk0:request-head:v1";

    fn signer(&self) -> NodeId {
        self.sender
    }
}

/// A request's arrival, compared with its head before the message is read.
#[derive(Clone, Copy, Debug)]
pub struct Arrived {
    /// The network of the aggregator.
    pub network: Digest,
    /// The run of the aggregator.
    pub run: [u8; 16],
    /// The aggregator's clock, in Unix milliseconds.
    pub now_ms: u64,
    /// The allowed difference of the two clocks, in milliseconds.
    pub skew_ms: u64,
}

/// A request's content, compared with its head.
#[derive(Clone, Copy, Debug)]
pub struct RequestContent {
    /// The called method.
    pub method: Method,
    /// The round in the request's statement, if any.
    pub round: Option<u64>,
    /// SHA-256 of the request's statement.
    pub body: Digest,
    /// The statement's signer, the only allowed sender.
    pub signer: NodeId,
}

/// Why a head does not count.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeadRefusal {
    /// The request has no head.
    #[error("the request has no signed head: use a client of this release of zk0, and a proxy that keeps the metadata")]
    Missing,
    /// The bytes are not a head.
    #[error("the head of the request is not valid: {0}")]
    Malformed(String),
    /// It is for another network.
    #[error("the head of the request is for network {head}, not for network {ours}")]
    Network { head: Digest, ours: Digest },
    /// The aggregator has restarted since.
    #[error("the aggregator was started again since the head of this request was signed: ask GetNetwork for its run, and sign again")]
    Run,
    /// It is for another method.
    #[error("the head of the request is for {head}, not for {called}")]
    Method { head: Method, called: Method },
    /// It is for another round.
    #[error("the head of the request is for {}, but its message is for {}", round(.head), round(.message))]
    Round {
        head: Option<u64>,
        message: Option<u64>,
    },
    /// It is for another message.
    #[error("the head of the request is for a message with SHA-256 {head}, not for this one with {message}")]
    Body { head: Digest, message: Digest },
    /// The sender did not sign the message.
    #[error("the head of the request names {sender} as the sender, but {signer} signed the message: only the signer sends it")]
    Sender { sender: NodeId, signer: NodeId },
    /// The clocks differ too much, or the request was too slow.
    #[error(
        "the head of the request was signed at {sender_ms} by the clock of its sender, and the aggregator's clock shows {ours_ms} (Unix \
         milliseconds): they differ by {} s, and {} s are allowed. Set the clock that is wrong",
        seconds(.sender_ms.abs_diff(*.ours_ms)), seconds(*.skew_ms)
    )]
    Time {
        sender_ms: u64,
        ours_ms: u64,
        skew_ms: u64,
    },
    /// The sender did not sign it.
    #[error("the head of the request: {0}")]
    Signature(#[from] SignatureError),
    /// It came before.
    #[error("the head of the request has come before: a head counts once")]
    Replayed,
    /// The aggregator has forgotten that time's heads.
    #[error("the head of the request was signed at {sender_ms} (Unix milliseconds), and the aggregator no longer knows which heads of that time have come: sign again")]
    Forgotten { sender_ms: u64 },
    /// The sender sent too many requests.
    #[error("{sender} has sent {limit} requests within the time for which the aggregator remembers them: wait a few minutes")]
    TooMany { sender: NodeId, limit: usize },
}

fn round(round: &Option<u64>) -> String {
    match round {
        Some(round) => format!("round {round}"),
        None => "no round".into(),
    }
}

fn seconds(ms: u64) -> String {
    format!("{}.{:03}", ms / 1000, ms % 1000)
}

impl Signed<RequestHead> {
    /// Reads a head from exactly these bytes.
    ///
    /// # Errors
    /// [`HeadRefusal::Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, HeadRefusal> {
        if bytes.len() > MAX_HEAD_BYTES {
            return Err(HeadRefusal::Malformed(format!(
                "it has {} bytes, at most {MAX_HEAD_BYTES} are read",
                bytes.len()
            )));
        }
        borsh::from_slice(bytes).map_err(|error| HeadRefusal::Malformed(error.to_string()))
    }

    /// Compares a head with its arrival, then verifies its signature. Replays are not checked here.
    ///
    /// # Errors
    /// The first field that differs.
    pub fn authenticate(self, arrived: &Arrived) -> Result<RequestHead, HeadRefusal> {
        let head = &self.statement;
        if head.network != arrived.network {
            return Err(HeadRefusal::Network {
                head: head.network,
                ours: arrived.network,
            });
        }
        if head.run != arrived.run {
            return Err(HeadRefusal::Run);
        }
        if head.time_ms.abs_diff(arrived.now_ms) > arrived.skew_ms {
            return Err(HeadRefusal::Time {
                sender_ms: head.time_ms,
                ours_ms: arrived.now_ms,
                skew_ms: arrived.skew_ms,
            });
        }
        self.verify()?;
        Ok(self.statement)
    }
}

impl RequestHead {
    /// Compares a head with its message.
    ///
    /// # Errors
    /// The first field that differs.
    pub fn check(&self, arrived: &RequestContent) -> Result<(), HeadRefusal> {
        let head = self;
        if head.method != arrived.method {
            return Err(HeadRefusal::Method {
                head: head.method,
                called: arrived.method,
            });
        }
        if head.round != arrived.round {
            return Err(HeadRefusal::Round {
                head: head.round,
                message: arrived.round,
            });
        }
        if head.body != arrived.body {
            return Err(HeadRefusal::Body {
                head: head.body,
                message: arrived.body,
            });
        }
        if head.sender != arrived.signer {
            return Err(HeadRefusal::Sender {
                sender: head.sender,
                signer: arrived.signer,
            });
        }
        Ok(())
    }
}
