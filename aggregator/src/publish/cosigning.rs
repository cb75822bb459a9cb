//! Asking witnesses for cosignatures (C2SP tlog-witness, `add-checkpoint`): all at once, until the quorum of the policy is
//! met or the time is over.

use crate::publish::http_client::post;
use std::{
    sync::{
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc, Arc,
    },
    thread,
    time::{Duration, Instant},
};
use zk0_circuits::Digest;
use zk0_ledger::published::web::agent;
use zk0_protocol::tlog::{
    checkpoint::{CheckpointError, Parsed},
    cosigner,
    witness::AddCheckpoint,
    witness_policy::{Witness, WitnessPolicy},
};

/// Longest answer of a witness that is read, in bytes.
const MAX_ANSWER_BYTES: u64 = 16 << 10;

/// How often a witness is asked again because it knows another size than we thought.
const ATTEMPTS: usize = 3;

/// Makes the consistency proof from one size to another.
pub type Prove = Arc<dyn Fn(u64, u64) -> Result<Vec<Digest>, String> + Send + Sync>;

/// The witnesses of a policy, and what is known of each.
pub struct Witnesses {
    policy: WitnessPolicy,
    clients: Vec<Arc<Client>>,
    deadline: Duration,
}

/// Why a checkpoint is not cosigned.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CosigningError {
    /// The checkpoint is none.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A witness that cannot be asked.
    #[error("the policy has no address for witness {0}: add it to its line")]
    NoAddress(String),
    /// Too few cosignatures in time.
    #[error("no quorum of cosignatures: {wanted} wanted; {}", .refused.join("; "))]
    NoQuorum {
        wanted: String,
        refused: Vec<String>,
    },
}

struct Client {
    witness: Witness,
    url: String,
    agent: ureq::Agent,
    /// Size of the last checkpoint that it cosigned, as far as we know.
    known: AtomicU64,
    /// A request is under way, from an earlier checkpoint perhaps.
    busy: AtomicBool,
}

impl Witnesses {
    /// The witnesses of `policy`, each of which has `deadline` to answer.
    pub fn new(policy: WitnessPolicy, deadline: Duration) -> Result<Self, CosigningError> {
        let clients = policy
            .witnesses()
            .iter()
            .map(|witness| {
                let missing = || CosigningError::NoAddress(witness.name.clone());
                let url = witness.url.as_deref().ok_or_else(missing)?;
                Ok(Arc::new(Client {
                    witness: witness.clone(),
                    url: format!("{}/add-checkpoint", url.trim_end_matches('/')),
                    agent: agent(deadline),
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

    /// How long a checkpoint may take to be cosigned, if one before it is being cosigned already.
    pub fn patience(&self) -> Duration {
        2 * self.deadline + Duration::from_secs(1)
    }

    /// Collects cosignatures of a checkpoint with the log's signature: the checkpoint with all that came until the quorum
    /// was met.
    pub fn cosign(&self, checkpoint: &[u8], prove: &Prove) -> Result<Vec<u8>, CosigningError> {
        let size = Parsed::read(checkpoint)?.checkpoint.size;
        let until = Instant::now() + self.deadline;
        let (sender, answers) = mpsc::channel();
        for (at, client) in self.clients.iter().enumerate() {
            let (client, sender) = (client.clone(), sender.clone());
            let (checkpoint, prove) = (checkpoint.to_vec(), prove.clone());
            if client.busy.swap(true, Ordering::AcqRel) {
                let _ = sender.send((at, Err("has not answered an earlier request".into())));
                continue;
            }
            thread::spawn(move || {
                let answer = client.ask(&checkpoint, size, &prove);
                client.busy.store(false, Ordering::Release);
                let _ = sender.send((at, answer));
            });
        }
        drop(sender);
        let mut note = checkpoint.to_vec();
        let mut cosigned = vec![false; self.clients.len()];
        let mut refused = Vec::new();
        while !self.policy.met_by(&cosigned) {
            let left = until.saturating_duration_since(Instant::now());
            let Ok((at, answer)) = answers.recv_timeout(left) else {
                break;
            };
            match answer {
                Ok(line) => {
                    note.extend(line);
                    cosigned[at] = true;
                }
                Err(why) => refused.push(format!("{} {why}", self.clients[at].witness.name)),
            }
        }
        match self.policy.met_by(&cosigned) {
            true => Ok(note),
            false => Err(CosigningError::NoQuorum {
                wanted: self.policy.to_string(),
                refused,
            }),
        }
    }
}

impl Client {
    /// Asks for a cosignature; the signature line, or what went wrong.
    fn ask(&self, checkpoint: &[u8], size: u64, prove: &Prove) -> Result<Vec<u8>, String> {
        let note = Parsed::read(checkpoint)
            .map_err(|error| error.to_string())?
            .note;
        for _ in 0..ATTEMPTS {
            let old = self.known.load(Ordering::Acquire);
            if old > size {
                return Err(format!(
                    "has cosigned {old} entries of this log, but it has {size} now: the log was rolled back, or an old \
                     checkpoint was submitted"
                ));
            }
            let proof = match old == 0 || old == size {
                true => Vec::new(),
                false => prove(old, size)?,
            };
            let request = AddCheckpoint {
                old,
                proof,
                checkpoint: checkpoint.into(),
            };
            let answer = post(&self.agent, &self.url, &request.encode(), MAX_ANSWER_BYTES)
                .map_err(|error| format!("cannot be asked: {error}"))?;
            let text = || String::from_utf8_lossy(&answer.body).trim().to_owned();
            match answer.status {
                200 => {
                    let line = cosigner::find(&answer.body, &self.witness.key, &note)
                        .ok_or("answered without a valid cosignature of this checkpoint")?;
                    self.known.store(size, Ordering::Release);
                    return Ok(line.to_bytes());
                }
                // With another text, another tree of this size was cosigned.
                status => match (status, text().parse()) {
                    (409, Ok(last)) => self.known.store(last, Ordering::Release),
                    _ => {
                        let text: String = text().chars().take(200).collect();
                        return Err(format!("refuses (status {status}): {text}"));
                    }
                },
            }
        }
        Err("keeps naming other sizes".into())
    }
}
