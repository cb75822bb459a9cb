//! Asks one witness for cosignatures, and keeps what the log knows of it: what it has cosigned, since when it does not cosign, and when it
//! is asked next.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use tracing::info_span;
use zk0_circuits::Digest;
use zk0_ledger::published::http_client::{HttpClient, HttpError};
use zk0_protocol::challenge::drawing::Cosignature;
use zk0_protocol::growing_waits::GrowingWaits;
use zk0_protocol::quote::short;
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner;
use zk0_protocol::tlog::witness::AddCheckpoint;
use zk0_protocol::tlog::witness_policy::PolicyWitness;
use zk0_service::traces::carried::{self, TRACEPARENT};

/// Largest answer of a witness that is read, in bytes.
const MAX_ANSWER_BYTES: u64 = 16 << 10;

/// How often a witness is asked because it knows another size of the log.
const ATTEMPTS: usize = 3;

/// The endless waits before a witness that does not cosign is asked again.
const WAITS: GrowingWaits = GrowingWaits {
    first: Duration::from_millis(250),
    longest: Duration::from_secs(60),
};

/// The longest wait that a witness can ask for.
const MOST_TOLD: Duration = Duration::from_secs(600);

/// Makes the consistency proof from one size to another.
pub type ConsistencyProver = Arc<dyn Fn(u64, u64) -> Result<Vec<Digest>, String> + Send + Sync>;

/// Why a witness does not cosign.
#[derive(Debug, thiserror::Error)]
pub enum NotCosigned {
    /// It has cosigned a later checkpoint.
    #[error("has cosigned {last} entries of this log, but it has {size} now: the log was rolled back, or an old checkpoint was submitted")]
    Behind { last: u64, size: u64 },
    /// It has too much to do, and names a time to ask again.
    #[error("refuses (status {status}): {text}")]
    Busy {
        status: u16,
        after: Duration,
        text: String,
    },
    /// It answers with this status and text. 409 and 422 mean that the tree does not continue the one that it has cosigned.
    #[error("refuses (status {0}): {1}")]
    Status(u16, String),
    /// It cannot be asked, or its answer is not the specification's.
    #[error("{0}")]
    Failed(String),
}

impl NotCosigned {
    /// Whether the witness has cosigned more entries than the log has, or others.
    pub fn contradicts(&self) -> bool {
        matches!(self, Self::Behind { .. } | Self::Status(409 | 422, _))
    }

    fn told(&self) -> Duration {
        match self {
            Self::Busy { after, .. } => (*after).min(MOST_TOLD),
            Self::Behind { .. } | Self::Status(..) | Self::Failed(_) => Duration::ZERO,
        }
    }
}

/// What is known of a witness.
#[derive(Clone, Debug)]
pub struct WitnessState {
    /// Its name in the policy.
    pub name: String,
    /// When it cosigned last, or else when it became known.
    pub last_signature: Instant,
    /// How often it was asked in vain.
    pub failures: u64,
    /// Absent while it cosigns.
    pub outage: Option<WitnessOutage>,
}

/// A witness does not cosign.
#[derive(Clone, Debug)]
pub struct WitnessOutage {
    /// Since when.
    pub since: Instant,
    /// How often it was asked in vain since then.
    pub attempts: u32,
    /// Its last answer, or why there was none.
    pub why: String,
    /// Whether it has cosigned more entries than the log has, or others.
    pub contradicts: bool,
    /// When it is asked next.
    pub next: Instant,
}

#[derive(Clone)]
pub(super) struct SignedCheckpoint {
    checkpoint: Vec<u8>,
    /// The note's line with the cosignature.
    pub line: Vec<u8>,
    pub cosignature: Cosignature,
}

/// Counts answers of witnesses, for those who wait for one.
#[derive(Default)]
pub(super) struct AnswerCount {
    count: Mutex<u64>,
    more: Condvar,
}

pub(super) struct CosigningClient {
    pub witness: PolicyWitness,
    url: String,
    http: HttpClient,
    record: Mutex<WitnessRecord>,
}

struct WitnessRecord {
    state: WitnessState,
    /// The size of the last checkpoint that the witness has cosigned, as far as we know.
    known: u64,
    signed: Option<SignedCheckpoint>,
    /// A request is in progress, perhaps about an earlier checkpoint.
    asked: bool,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic elsewhere leaves these values whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl AnswerCount {
    pub fn now(&self) -> u64 {
        *locked(&self.count)
    }

    fn add(&self) {
        *locked(&self.count) += 1;
        self.more.notify_all();
    }

    /// Waits until there are more answers than were `seen`. Returns `false` if there are none in time.
    pub fn wait(&self, seen: u64, until: Instant) -> bool {
        let left = until.saturating_duration_since(Instant::now());
        let none = |count: &mut u64| *count == seen;
        let waited = self
            .more
            .wait_timeout_while(locked(&self.count), left, none);
        let (count, _) = waited.unwrap_or_else(PoisonError::into_inner);
        *count != seen
    }
}

impl CosigningClient {
    /// Asks the witness at `url`, which may end with a slash.
    pub fn new(witness: &PolicyWitness, url: &str, http: HttpClient) -> Self {
        Self {
            witness: witness.clone(),
            url: format!("{}/add-checkpoint", url.trim_end_matches('/')),
            http,
            record: Mutex::new(WitnessRecord {
                state: WitnessState {
                    name: witness.name.clone(),
                    last_signature: Instant::now(),
                    failures: 0,
                    outage: None,
                },
                known: 0,
                signed: None,
                asked: false,
            }),
        }
    }

    /// What is known of the witness.
    pub fn state(&self) -> WitnessState {
        locked(&self.record).state.clone()
    }

    /// Its answer, if it contradicts and has not cosigned since the start. One that has refuses an earlier checkpoint for good reason.
    pub fn contradiction(&self) -> Option<String> {
        let record = locked(&self.record);
        let outage = record.state.outage.as_ref();
        let outage = outage.filter(|outage| outage.contradicts && record.signed.is_none());
        outage.map(|outage| outage.why.clone())
    }

    /// What the witness has cosigned, if it is this checkpoint.
    pub fn signed(&self, checkpoint: &[u8]) -> Option<SignedCheckpoint> {
        locked(&self.record).signed(checkpoint).cloned()
    }

    /// Whether the witness has not cosigned this checkpoint, and is or may be asked now.
    pub fn may_cosign(&self, checkpoint: &[u8]) -> bool {
        let record = locked(&self.record);
        record.signed(checkpoint).is_none() && (record.asked || record.is_due())
    }

    /// Whether the witness may be asked now: an outage has its waits.
    pub fn is_due(&self) -> bool {
        locked(&self.record).is_due()
    }

    /// Asks for a cosignature of this checkpoint of `size` entries, unless a request is in progress, or the witness is asked later. Adds
    /// the answer to `answers`, without a wait. Returns whether a request is in progress.
    pub fn begin(
        self: &Arc<Self>,
        (checkpoint, size): (&[u8], u64),
        prove: &ConsistencyProver,
        answers: &Arc<AnswerCount>,
    ) -> bool {
        {
            let mut record = locked(&self.record);
            if record.asked {
                return true;
            }
            if !record.is_due() {
                return false;
            }
            record.asked = true;
        }
        let span = info_span!("ask a witness", zk0.witness = self.witness.name);
        let (client, answers) = (self.clone(), answers.clone());
        let (checkpoint, prove) = (checkpoint.to_vec(), prove.clone());
        thread::spawn(move || {
            // Its outcome is in the record.
            let _ = span.in_scope(|| client.ask(&checkpoint, size, &prove));
            locked(&client.record).asked = false;
            answers.add();
        });
        true
    }

    /// Asks for a cosignature, and keeps what comes of it.
    pub fn ask(
        &self,
        checkpoint: &[u8],
        size: u64,
        prove: &ConsistencyProver,
    ) -> Result<(), NotCosigned> {
        let answer = self.answer(checkpoint, size, prove);
        let mut record = locked(&self.record);
        match answer {
            Ok(signed) => {
                record.cosigned(signed);
                Ok(())
            }
            Err(why) => {
                record.failed(&why);
                Err(why)
            }
        }
    }

    /// Whether the witness cosigns this log, whatever it has cosigned of it.
    pub fn knows(&self, checkpoint: &[u8]) -> Result<(), NotCosigned> {
        let failed = |why: String| NotCosigned::Failed(why);
        let note = Parsed::read(checkpoint);
        let note = note.map_err(|error| failed(error.to_string()))?.note;
        let request = AddCheckpoint {
            old: 0,
            proof: Vec::new(),
            checkpoint: checkpoint.into(),
        };
        let answered = self.post(&request.encode());
        let (status, _, answer) =
            answered.map_err(|error| failed(format!("cannot be asked: {error}")))?;
        let text = String::from_utf8_lossy(&answer);
        let text = text.trim();
        let cosigned = || cosigner::find(&answer, &self.witness.key, &note).is_some();
        match status {
            200 if cosigned() => Ok(()),
            200 => Err(failed(
                "answered without a valid cosignature of this checkpoint".into(),
            )),
            // It names the size that it knows.
            409 if text.parse::<u64>().is_ok() => Ok(()),
            status => Err(NotCosigned::Status(status, short(text))),
        }
    }

    fn answer(
        &self,
        checkpoint: &[u8],
        size: u64,
        prove: &ConsistencyProver,
    ) -> Result<SignedCheckpoint, NotCosigned> {
        let failed = |why: &str| NotCosigned::Failed(why.into());
        let note = Parsed::read(checkpoint)
            .map_err(|error| failed(&error.to_string()))?
            .note;
        for _ in 0..ATTEMPTS {
            let last = locked(&self.record).known;
            if last > size {
                return Err(NotCosigned::Behind { last, size });
            }
            let proof = if last == 0 || last == size {
                Vec::new()
            } else {
                prove(last, size).map_err(NotCosigned::Failed)?
            };
            let request = AddCheckpoint {
                old: last,
                proof,
                checkpoint: checkpoint.into(),
            };
            let (status, after, answer) = self
                .post(&request.encode())
                .map_err(|error| failed(&format!("cannot be asked: {error}")))?;
            let text = || String::from_utf8_lossy(&answer).trim().to_owned();
            match status {
                200 => {
                    let signature =
                        cosigner::find(&answer, &self.witness.key, &note).ok_or_else(|| {
                            failed("answered without a valid cosignature of this checkpoint")
                        })?;
                    let cosignature = signature.signature().try_into();
                    let cosignature = cosignature
                        .map_err(|_| failed("answered with a cosignature of another length"))?;
                    locked(&self.record).known = size;
                    return Ok(SignedCheckpoint {
                        checkpoint: checkpoint.into(),
                        line: signature.to_bytes(),
                        cosignature,
                    });
                }
                429 | 503 => {
                    return Err(NotCosigned::Busy {
                        status,
                        after,
                        text: short(&text()),
                    })
                }
                // 409 with a number names the size that the witness knows; with a text, the witness has cosigned another tree of this size.
                status => match (status, text().parse()) {
                    (409, Ok(last)) => locked(&self.record).known = last,
                    _ => return Err(NotCosigned::Status(status, short(&text()))),
                },
            }
        }
        Err(failed("names another size each time it is asked"))
    }

    /// Sends a body. Returns the status, how long the witness wants not to be asked, and the answer's body.
    fn post(&self, body: &[u8]) -> Result<(u16, Duration, Vec<u8>), HttpError> {
        let parent = carried::traceparent();
        let headers = parent.iter().map(|parent| (TRACEPARENT, &**parent));
        let headers: Vec<_> = headers.collect();
        let mut response = self.http.post(&self.url, &headers, body)?;
        let after = response.headers().get("retry-after");
        let after = after.and_then(|after| after.to_str().ok()?.trim().parse().ok());
        let after = after.map_or(Duration::ZERO, Duration::from_secs);
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES);
        let body = body.read_to_vec();
        let body = body.map_err(|error| self.http.why(&error))?;
        Ok((response.status().as_u16(), after, body))
    }
}

impl WitnessRecord {
    fn signed(&self, checkpoint: &[u8]) -> Option<&SignedCheckpoint> {
        let signed = self.signed.as_ref();
        signed.filter(|signed| signed.checkpoint == checkpoint)
    }

    fn is_due(&self) -> bool {
        let outage = self.state.outage.as_ref();
        outage.is_none_or(|outage| Instant::now() >= outage.next)
    }

    fn cosigned(&mut self, signed: SignedCheckpoint) {
        self.signed = Some(signed);
        self.state.last_signature = Instant::now();
        if let Some(outage) = self.state.outage.take() {
            let waited = outage.since.elapsed().as_secs();
            tracing::info!(
                "witness {} cosigns again, after {waited} s",
                self.state.name
            );
        }
    }

    fn failed(&mut self, why: &NotCosigned) {
        let (now, text) = (Instant::now(), why.to_string());
        let before = self.state.outage.take();
        // The log has each reason once.
        if before.as_ref().is_none_or(|before| before.why != text) {
            tracing::warn!(
                "witness {} {text}; it is asked again, after longer and longer waits",
                self.state.name
            );
        }
        let (since, attempts) = before.map_or((now, 0), |before| (before.since, before.attempts));
        let wait = WAITS.wait(attempts, random(), why.told());
        self.state.failures += 1;
        self.state.outage = Some(WitnessOutage {
            since,
            attempts: attempts.saturating_add(1),
            why: text,
            contradicts: why.contradicts(),
            next: now + wait,
        });
    }
}

/// Draws a wait: the longest without a random number.
fn random() -> u32 {
    getrandom::u32().unwrap_or(u32::MAX)
}
