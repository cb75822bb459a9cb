//! A witness on the network: C2SP tlog-witness' `add-checkpoint`, and the last cosigned checkpoint of each log.

use crate::clock::Clock;
use crate::publish::http::{answer, text, HttpLimits, Router, NO_CACHE, TEXT};
use crate::publish::witness_metrics::WitnessMetrics;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::header::RETRY_AFTER;
use axum::http::{HeaderMap, HeaderValue};
use axum::response::Response;
use axum::routing::{get, post};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tracing::field::Empty;
use tracing::{info_span, Span};
use zk0_ledger::witness_store::{AddError, WitnessStore};
use zk0_protocol::tlog::witness::{WitnessRefusal, MAX_REQUEST_BYTES};
use zk0_service::traces::carried;

/// Requests that wait. Each takes about as long as its write to disk.
const QUEUE: usize = 64;

/// How often the log states an invalid consistency proof.
const SAY_AGAIN: Duration = Duration::from_secs(60);

/// Serves one witness.
pub struct WitnessServer {
    /// Locked for a whole request, which reads and replaces a log's last checkpoint.
    witness: Mutex<WitnessStore>,
    queue: Semaphore,
    clock: Arc<dyn Clock>,
    /// When the log last stated an invalid consistency proof.
    reported: Mutex<Option<Duration>>,
    metrics: WitnessMetrics,
}

impl WitnessServer {
    /// Serves `witness` by this clock.
    pub fn new(witness: WitnessStore, clock: Arc<dyn Clock>) -> Self {
        let metrics = WitnessMetrics::default();
        metrics.keeps(witness.sizes());
        Self {
            witness: Mutex::new(witness),
            queue: Semaphore::new(QUEUE),
            clock,
            reported: Mutex::new(None),
            metrics,
        }
    }

    /// What the server counts.
    pub fn metrics(&self) -> &WitnessMetrics {
        &self.metrics
    }

    /// The limits of such a server.
    pub fn limits() -> HttpLimits {
        HttpLimits {
            body: MAX_REQUEST_BYTES,
            ..HttpLimits::default()
        }
    }

    /// The witness' routes.
    pub fn router(self) -> Router {
        let only_posted = || async { text(405, "a checkpoint is sent with POST\n") };
        let only_read = || async { text(405, "the last checkpoint can only be read\n") };
        Router::new()
            .route("/add-checkpoint", post(add).fallback(only_posted))
            .route("/{log}/checkpoint", get(last).fallback(only_read))
            .fallback(|| async { text(404, "a witness has no such file\n") })
            .with_state(Arc::new(self))
    }

    fn add(&self, body: &[u8]) -> Response {
        let Ok(mut witness) = self.witness.lock() else {
            return text(500, "an earlier request failed\n");
        };
        match witness.add(body, self.clock.now_ms() / 1000) {
            Ok(line) => {
                self.metrics.keeps(witness.sizes());
                answer(200, TEXT, NO_CACHE, line)
            }
            Err(AddError::Refused(refusal @ WitnessRefusal::Conflict { last, .. })) => answer(
                refusal.status(),
                "text/x.tlog.size",
                NO_CACHE,
                format!("{last}\n"),
            ),
            Err(AddError::Refused(refusal)) => {
                self.log_refusal(&refusal);
                text(refusal.status(), format!("{refusal}\n"))
            }
            Err(AddError::Failed(error)) => {
                self.metrics.keeps_none(error.to_string());
                tracing::error!("{error}");
                text(500, "the witness failed; its log states why\n")
            }
        }
    }

    fn log_refusal(&self, refusal: &WitnessRefusal) {
        match refusal {
            // Two signed roots of one size are evidence.
            WitnessRefusal::OtherTree { .. } => {
                tracing::error!("a log shows two histories: {refusal}");
            }
            // Strangers can send genuine checkpoints with wrong proofs. This shows nothing about the log, and must not fill the disk.
            WitnessRefusal::Inconsistent { .. } if self.says_again() => {
                tracing::warn!("a request has no valid consistency proof: {refusal}");
            }
            _ => {}
        }
    }

    /// Whether the log may state an invalid consistency proof again, which then counts as stated.
    fn says_again(&self) -> bool {
        let Ok(mut reported) = self.reported.lock() else {
            return false;
        };
        let now = self.clock.steady();
        let may = reported.is_none_or(|at| now.saturating_sub(at) >= SAY_AGAIN);
        if may {
            *reported = Some(now);
        }
        may
    }

    fn last(&self, origin_hash: &str) -> Response {
        let Ok(witness) = self.witness.lock() else {
            return text(500, "an earlier request failed\n");
        };
        match witness.last(origin_hash) {
            Ok(Some(note)) => answer(200, TEXT, NO_CACHE, note),
            Ok(None) => text(
                404,
                "this witness has cosigned no checkpoint of such a log\n",
            ),
            Err(error) => {
                tracing::error!("{error}");
                text(500, "the witness failed; its log states why\n")
            }
        }
    }
}

async fn add(
    State(server): State<Arc<WitnessServer>>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let span = info_span!(
        "cosign a checkpoint",
        otel.kind = "server",
        http.response.status_code = Empty,
    );
    carried::follow(&span, &headers);
    let Ok(_place) = server.queue.try_acquire() else {
        let mut busy = text(
            429,
            "too many requests wait already: ask again in a second\n",
        );
        busy.headers_mut()
            .insert(RETRY_AFTER, HeaderValue::from_static("1"));
        server.metrics.answered(429);
        return busy;
    };
    let server = server.clone();
    answered(move || {
        span.in_scope(|| {
            let response = server.add(&body);
            let status = response.status().as_u16();
            Span::current().record("http.response.status_code", status);
            server.metrics.answered(status);
            response
        })
    })
    .await
}

async fn last(State(server): State<Arc<WitnessServer>>, Path(log): Path<String>) -> Response {
    answered(move || server.last(&log)).await
}

/// Runs `work`, which uses files, away from the network's threads.
async fn answered(work: impl FnOnce() -> Response + Send + 'static) -> Response {
    let done = spawn_blocking(work).await;
    done.unwrap_or_else(|_| text(500, "the witness failed\n"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SystemClock;
    use ed25519_dalek::SigningKey;
    use zk0_protocol::tlog::cosigner::Cosigner;

    #[tokio::test]
    async fn a_request_beyond_the_queue_is_told_to_ask_again() {
        let dir = tempfile::tempdir().unwrap();
        let cosigner =
            Cosigner::new("witness.example/w", SigningKey::from_bytes(&[1; 32])).unwrap();
        let witness = WitnessStore::open(dir.path(), cosigner, vec![]).unwrap();
        let server = Arc::new(WitnessServer::new(witness, Arc::new(SystemClock)));
        let send = || add(State(server.clone()), HeaderMap::new(), Bytes::new());
        let waiting = server.queue.acquire_many(QUEUE as u32).await.unwrap();
        let refused = send().await;
        assert_eq!(refused.status(), 429);
        assert_eq!(refused.headers()[RETRY_AFTER], "1");
        drop(waiting);
        assert_eq!(send().await.status(), 400);
    }
}
