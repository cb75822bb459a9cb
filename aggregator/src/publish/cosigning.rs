//! Asks witnesses for cosignatures (C2SP tlog-witness, `add-checkpoint`), all at once, until the policy's quorum is met or time is over.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{mpsc, Arc};
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};
use tracing::{info_span, instrument, Span};
use zk0_circuits::Digest;
use zk0_ledger::published::http_client::{HttpClient, HttpError};
use zk0_protocol::challenge::drawing::Cosignature;
use zk0_protocol::quote::short;
use zk0_protocol::tlog::checkpoint::{CheckpointError, Parsed};
use zk0_protocol::tlog::cosigner;
use zk0_protocol::tlog::witness::AddCheckpoint;
use zk0_protocol::tlog::witness_policy::{PolicyWitness, WitnessPolicy};
use zk0_tls::authorities::{Authorities, AuthoritiesError};
use zk0_traces::carried::{self, TRACEPARENT};

/// Largest answer that is read, in bytes.
const MAX_ANSWER_BYTES: u64 = 16 << 10;

/// Tries while a witness knows another size of the log.
const ATTEMPTS: usize = 3;

/// Makes the consistency proof from one size to another.
pub type ConsistencyProver = Arc<dyn Fn(u64, u64) -> Result<Vec<Digest>, String> + Send + Sync>;

/// The witnesses of a policy, and what the log knows of each.
pub struct Witnesses {
    policy: WitnessPolicy,
    clients: Vec<Arc<CosigningClient>>,
    deadline: Duration,
}

/// Why a checkpoint is not cosigned.
#[derive(Debug, thiserror::Error)]
pub enum CosigningError {
    /// The text is not a checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A witness has no address.
    #[error("the witness policy has no address for witness {0}: add the address to the line of the witness")]
    NoAddress(String),
    /// A witness's address is not encrypted, but a file names trusted certificates.
    #[error("{file} says whose certificates count for witnesses, but witness {name} at {url} has none: use https:// in the witness policy")]
    NotEncrypted {
        name: String,
        url: String,
        file: String,
    },
    /// The file of trusted certificates cannot be used.
    #[error(transparent)]
    Authorities(#[from] AuthoritiesError),
    /// A witness has cosigned more of the log, or another history.
    #[error("witness {name} {why}")]
    OtherHistory { name: String, why: NotCosigned },
    /// Too few witnesses have cosigned in time.
    #[error("too few witnesses have cosigned: the policy asks for {wanted}; {}", .refused.join("; "))]
    NoQuorum {
        wanted: String,
        refused: Vec<String>,
    },
}

/// Why a witness does not cosign.
#[derive(Debug, thiserror::Error)]
pub enum NotCosigned {
    /// It has cosigned a later checkpoint.
    #[error("has cosigned {last} entries of this log, but it has {size} now: the log was rolled back, or an old checkpoint was submitted")]
    Behind { last: u64, size: u64 },
    /// Its status and text. 409 and 422 mean that the tree does not continue the one that it has cosigned.
    #[error("refuses (status {0}): {1}")]
    Status(u16, String),
    /// It cannot be asked, or its answer breaks the specification.
    #[error("{0}")]
    Failed(String),
}

/// A checkpoint that witnesses have cosigned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cosigned {
    /// The checkpoint with its cosignatures, as a note.
    pub note: Vec<u8>,
    /// The cosignatures, in the policy's order.
    pub cosignatures: Vec<Cosignature>,
}

struct CosigningClient {
    witness: PolicyWitness,
    url: String,
    client: HttpClient,
    /// The size that the witness last cosigned, as far as known.
    known: AtomicU64,
    /// An earlier request is not answered yet.
    busy: AtomicBool,
}

impl Witnesses {
    /// The witnesses of `policy`, each with `deadline` to answer. The system's trusted certificates count.
    pub fn new(policy: WitnessPolicy, deadline: Duration) -> Result<Self, CosigningError> {
        Self::believing(policy, deadline, &Authorities::of_system("--witness-ca"))
    }

    /// Like [`Self::new`], but with certificates signed by one of `authorities`.
    ///
    /// # Errors
    /// A witness has no address, the authorities cannot be read, or they come from a file and a witness has no certificate.
    pub fn believing(
        policy: WitnessPolicy,
        deadline: Duration,
        authorities: &Authorities,
    ) -> Result<Self, CosigningError> {
        let http = HttpClient::new(authorities.clone(), deadline)?;
        let clients = policy
            .witnesses()
            .iter()
            .map(|witness| {
                let missing = || CosigningError::NoAddress(witness.name.clone());
                let url = witness.url.as_deref().ok_or_else(missing)?;
                if let (Some(file), false) = (authorities.file(), url.starts_with("https://")) {
                    return Err(CosigningError::NotEncrypted {
                        name: witness.name.clone(),
                        url: url.into(),
                        file: file.display().to_string(),
                    });
                }
                Ok(Arc::new(CosigningClient {
                    witness: witness.clone(),
                    url: format!("{}/add-checkpoint", url.trim_end_matches('/')),
                    client: http.clone(),
                    known: AtomicU64::new(0),
                    busy: AtomicBool::new(false),
                }))
            })
            .collect::<Result<_, CosigningError>>()?;
        Ok(Self {
            policy,
            clients,
            deadline,
        })
    }

    /// The policy.
    pub fn policy(&self) -> &WitnessPolicy {
        &self.policy
    }

    /// The longest time until a checkpoint is cosigned, after the one before it.
    pub fn patience(&self) -> Duration {
        2 * self.deadline + Duration::from_secs(1)
    }

    /// Has a signed checkpoint cosigned by a quorum.
    pub fn cosign(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
    ) -> Result<Cosigned, CosigningError> {
        let quorum = |cosigned: &[bool]| self.policy.met_by(cosigned);
        self.collect(checkpoint, prove, quorum, self.policy.to_string())
    }

    /// Has a checkpoint cosigned by all witnesses.
    pub fn cosign_all(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
    ) -> Result<Cosigned, CosigningError> {
        let all = |cosigned: &[bool]| cosigned.iter().all(|cosigned| *cosigned);
        let names = self.policy.witnesses().iter();
        let names: Vec<_> = names.map(|witness| witness.name.clone()).collect();
        let wanted = format!("all of ({})", names.join(", "));
        self.collect(checkpoint, prove, all, wanted)
    }

    /// Asks all witnesses whether the log with this newest `checkpoint` continues what they cosigned. Returns how many know.
    ///
    /// # Errors
    /// A witness has cosigned more entries, or others.
    pub fn continues(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
    ) -> Result<usize, CosigningError> {
        let size = Parsed::read(checkpoint)?.checkpoint.size;
        let answers: Vec<_> = thread::scope(|scope| {
            let ask = |client: &Arc<CosigningClient>| {
                let (client, here) = (client.clone(), Span::current());
                scope.spawn(move || {
                    let _here = here.enter();
                    let span = info_span!("ask a witness", zk0.witness = client.witness.name);
                    span.in_scope(|| client.ask(checkpoint, size, prove))
                })
            };
            let asked: Vec<_> = self.clients.iter().map(ask).collect();
            asked.into_iter().map(ScopedJoinHandle::join).collect()
        });
        let mut known = 0;
        for (client, answer) in self.clients.iter().zip(answers) {
            let name = client.witness.name.clone();
            match answer {
                Ok(Ok(_)) => known += 1,
                Ok(Err(why @ (NotCosigned::Behind { .. } | NotCosigned::Status(409 | 422, _)))) => {
                    return Err(CosigningError::OtherHistory { name, why })
                }
                Ok(Err(why)) => tracing::warn!("witness {name} {why}"),
                Err(panic) => resume_unwind(panic),
            }
        }
        Ok(known)
    }

    #[instrument(name = "publish a checkpoint", skip_all)]
    fn collect(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
        enough: impl Fn(&[bool]) -> bool,
        wanted: String,
    ) -> Result<Cosigned, CosigningError> {
        let size = Parsed::read(checkpoint)?.checkpoint.size;
        let until = Instant::now() + self.deadline;
        let (sender, answers) = mpsc::channel();
        for (at, client) in self.clients.iter().enumerate() {
            let (client, sender) = (client.clone(), sender.clone());
            let (checkpoint, prove) = (checkpoint.to_vec(), prove.clone());
            if client.busy.swap(true, Ordering::AcqRel) {
                let why = "has not answered an earlier request";
                let _ = sender.send((at, Err(NotCosigned::Failed(why.into()))));
                continue;
            }
            let span = info_span!("ask a witness", zk0.witness = client.witness.name);
            thread::spawn(move || {
                let answer = span.in_scope(|| client.ask(&checkpoint, size, &prove));
                client.busy.store(false, Ordering::Release);
                let _ = sender.send((at, answer));
            });
        }
        drop(sender);
        let mut note = checkpoint.to_vec();
        let mut cosigned = vec![false; self.clients.len()];
        let mut cosignatures = vec![None; self.clients.len()];
        let mut refused = Vec::new();
        while !enough(&cosigned) {
            let left = until.saturating_duration_since(Instant::now());
            let Ok((at, answer)) = answers.recv_timeout(left) else {
                break;
            };
            match answer {
                Ok((line, cosignature)) => {
                    note.extend(line);
                    cosigned[at] = true;
                    cosignatures[at] = Some(cosignature);
                }
                Err(why) => refused.push(format!("{} {why}", self.clients[at].witness.name)),
            }
        }
        if enough(&cosigned) {
            Ok(Cosigned {
                note,
                cosignatures: cosignatures.into_iter().flatten().collect(),
            })
        } else {
            Err(CosigningError::NoQuorum { wanted, refused })
        }
    }
}

impl CosigningClient {
    /// Returns the cosignature, after its line in the note.
    fn ask(
        &self,
        checkpoint: &[u8],
        size: u64,
        prove: &ConsistencyProver,
    ) -> Result<(Vec<u8>, Cosignature), NotCosigned> {
        let failed = |why: &str| NotCosigned::Failed(why.into());
        let note = Parsed::read(checkpoint)
            .map_err(|error| failed(&error.to_string()))?
            .note;
        for _ in 0..ATTEMPTS {
            let last = self.known.load(Ordering::Acquire);
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
            let (status, answer) = self
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
                    self.known.store(size, Ordering::Release);
                    return Ok((signature.to_bytes(), cosignature));
                }
                // 409 with a number gives the size that the witness knows. With a text, it has cosigned another tree of this size.
                status => match (status, text().parse()) {
                    (409, Ok(last)) => self.known.store(last, Ordering::Release),
                    _ => return Err(NotCosigned::Status(status, short(&text()))),
                },
            }
        }
        Err(failed("names another size each time it is asked"))
    }

    /// Returns the answer's status and body.
    fn post(&self, body: &[u8]) -> Result<(u16, Vec<u8>), HttpError> {
        let parent = carried::traceparent();
        let headers = parent.iter().map(|parent| (TRACEPARENT, &**parent));
        let headers: Vec<_> = headers.collect();
        let mut response = self.client.post(&self.url, &headers, body)?;
        let body = response.body_mut().with_config().limit(MAX_ANSWER_BYTES);
        let body = body.read_to_vec();
        let body = body.map_err(|error| self.client.why(&error))?;
        Ok((response.status().as_u16(), body))
    }
}
