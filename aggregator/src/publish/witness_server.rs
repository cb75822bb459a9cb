//! A witness on the network: C2SP tlog-witness' `add-checkpoint`, and the last cosigned checkpoint of each log for monitors.

use crate::{
    publish::http::{Body, Call, Handler, Limits, Reply, NO_CACHE, TEXT},
    round::clock::Clock,
};
use hyper::Method;
use std::sync::{Arc, Mutex};
use zk0_ledger::witness_store::{AddError, WitnessStore};
use zk0_protocol::tlog::witness::{WitnessRefusal, MAX_REQUEST_BYTES};

/// Serves one witness.
pub struct WitnessServer {
    /// One request at a time: between looking at the last checkpoint and replacing it, nobody else may.
    witness: Mutex<WitnessStore>,
    clock: Arc<dyn Clock>,
}

impl WitnessServer {
    /// Serves `witness` by this clock.
    pub fn new(witness: WitnessStore, clock: Arc<dyn Clock>) -> Self {
        Self {
            witness: Mutex::new(witness),
            clock,
        }
    }

    /// What such a server puts up with.
    pub fn limits() -> Limits {
        Limits {
            body: MAX_REQUEST_BYTES,
            ..Limits::default()
        }
    }

    fn add(&self, body: &[u8]) -> Reply {
        let Ok(mut witness) = self.witness.lock() else {
            return Reply::text(500, "an earlier request failed\n");
        };
        match witness.add(body, self.clock.now_ms() / 1000) {
            Ok(line) => Reply {
                status: 200,
                kind: TEXT,
                cache: NO_CACHE,
                body: Body::Bytes(line),
            },
            Err(AddError::Refused(refusal @ WitnessRefusal::Conflict { last, .. })) => Reply {
                kind: "text/x.tlog.size",
                ..Reply::text(refusal.status(), format!("{last}\n"))
            },
            Err(AddError::Refused(refusal)) => {
                use WitnessRefusal::{Inconsistent, OtherTree};
                if let Inconsistent { .. } | OtherTree { .. } = refusal {
                    tracing::error!("a log shows two histories: {refusal}");
                }
                Reply::text(refusal.status(), format!("{refusal}\n"))
            }
            Err(AddError::Failed(error)) => {
                tracing::error!("{error}");
                Reply::text(500, "the witness failed; its log says why\n")
            }
        }
    }

    fn last(&self, origin_hash: &str) -> Reply {
        let Ok(witness) = self.witness.lock() else {
            return Reply::text(500, "an earlier request failed\n");
        };
        match witness.last(origin_hash) {
            Ok(Some(note)) => Reply {
                status: 200,
                kind: TEXT,
                cache: NO_CACHE,
                body: Body::Bytes(note),
            },
            Ok(None) => Reply::text(404, "no checkpoint of such a log was cosigned here\n"),
            Err(error) => {
                tracing::error!("{error}");
                Reply::text(500, "the witness failed; its log says why\n")
            }
        }
    }
}

impl Handler for WitnessServer {
    fn answer(&self, call: &Call) -> Reply {
        match (call.path.as_str(), &call.method) {
            ("add-checkpoint", &Method::POST) => self.add(&call.body),
            ("add-checkpoint", _) => Reply::text(405, "checkpoints are posted\n"),
            (path, &Method::GET | &Method::HEAD) => match path.strip_suffix("/checkpoint") {
                Some(origin_hash) => self.last(origin_hash),
                None => Reply::text(404, "a witness has no such thing\n"),
            },
            _ => Reply::text(405, "a witness takes only checkpoints\n"),
        }
    }
}
