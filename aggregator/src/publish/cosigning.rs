//! Asks all witnesses for cosignatures at once (C2SP tlog-witness, `add-checkpoint`), until the policy's quorum is met or time is over. A
//! witness that does not cosign is asked again after growing waits.

use crate::publish::witness_client::{AnswerCount, CosigningClient, NotCosigned, WitnessState};
use std::panic::resume_unwind;
use std::sync::Arc;
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};
use tracing::{info_span, instrument, Span};
use zk0_ledger::published::http_client::HttpClient;
use zk0_protocol::challenge::drawing::Cosignature;
use zk0_protocol::tlog::checkpoint::{CheckpointError, Parsed};
use zk0_protocol::tlog::witness_policy::WitnessPolicy;
use zk0_service::tls::authorities::{Authorities, AuthoritiesError};

pub use crate::publish::witness_client::ConsistencyProver;

/// The witnesses of a policy, and what the log knows of each.
pub struct Witnesses {
    policy: WitnessPolicy,
    clients: Vec<Arc<CosigningClient>>,
    ignored: Vec<String>,
    answers: Arc<AnswerCount>,
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
    #[error("{file} states whose certificates count for witnesses, but witness {name} at {url} has none: use https:// in the witness policy")]
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
    /// The policy lacks a witness that is to be ignored.
    #[error("--ignore-witness {name}: the witness policy has only the witnesses {known}: name one of them, or leave the option out")]
    UnknownWitness { name: String, known: String },
    /// Too many witnesses are to be ignored.
    #[error("without the witnesses of --ignore-witness, the rest is no quorum: the policy asks for {0}. Ignore fewer; or, if you know that the newest checkpoint that the log has signed is of the ledger's SIZE entries, add --newest-checkpoint SIZE, and vote for other witnesses")]
    QuorumIgnored(String),
    /// Too few witnesses have cosigned in time.
    #[error("too few witnesses have cosigned: the policy asks for {wanted}; {}", .refused.join("; "))]
    NoQuorum {
        wanted: String,
        refused: Vec<String>,
    },
}

/// A checkpoint that witnesses have cosigned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cosigned {
    /// The checkpoint with its cosignatures, as a note.
    pub note: Vec<u8>,
    /// The cosignatures, in the policy's order.
    pub cosignatures: Vec<Cosignature>,
}

impl Witnesses {
    /// The witnesses of `policy`, each with `deadline` to answer. The system's trusted certificates count.
    pub fn new(policy: WitnessPolicy, deadline: Duration) -> Result<Self, CosigningError> {
        Self::believing(policy, deadline, &Authorities::of_system("--witness-ca"))
    }

    /// [`Self::new`], with certificates signed by one of `authorities`.
    ///
    /// # Errors
    /// A witness has no address; the authorities cannot be read; or they come from a file and a witness has no certificate.
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
                let client = CosigningClient::new(witness, url, http.clone());
                Ok(Arc::new(client))
            })
            .collect::<Result<_, CosigningError>>()?;
        Ok(Self {
            policy,
            clients,
            ignored: Vec::new(),
            answers: Arc::default(),
            deadline,
        })
    }

    /// Leaves these witnesses out of [`Self::continues`] and [`Self::contradiction`]. `is_newest` if the log is known to have signed nothing
    /// newer.
    ///
    /// # Errors
    /// The policy has no such witness; or the others are no quorum, so that they may all miss what the log has published.
    pub fn ignoring(mut self, names: &[String], is_newest: bool) -> Result<Self, CosigningError> {
        let known = self.policy.witnesses().iter().map(|witness| &witness.name);
        let known: Vec<_> = known.cloned().collect();
        if let Some(name) = names.iter().find(|name| !known.contains(name)) {
            return Err(CosigningError::UnknownWitness {
                name: name.clone(),
                known: known.join(", "),
            });
        }
        let compared: Vec<_> = known.iter().map(|name| !names.contains(name)).collect();
        if !is_newest && !self.policy.met_by(&compared) {
            return Err(CosigningError::QuorumIgnored(self.policy.to_string()));
        }
        self.ignored = names.to_vec();
        Ok(self)
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

    /// How the witnesses are, in the order of the policy.
    pub fn states(&self) -> Vec<WitnessState> {
        let states = self.clients.iter().map(|client| client.state());
        states.collect()
    }

    /// A witness that contradicts and has not cosigned since the start, and its answer.
    pub fn contradiction(&self) -> Option<(String, String)> {
        let mut compared = self.compared();
        compared.find_map(|client| Some((client.witness.name.clone(), client.contradiction()?)))
    }

    /// Whether a witness that has not cosigned this checkpoint is being asked, or may be asked now.
    pub fn may_answer(&self, checkpoint: &[u8]) -> bool {
        let mut clients = self.clients.iter();
        clients.any(|client| client.may_cosign(checkpoint))
    }

    /// Asks those witnesses again whose outage has lasted long enough. `checkpoint` is the log's newest one. Waits for no answer.
    pub fn ask_absent(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
    ) -> Result<(), CosigningError> {
        let size = Parsed::read(checkpoint)?.checkpoint.size;
        let absent = |client: &&Arc<CosigningClient>| client.state().outage.is_some();
        for client in self.clients.iter().filter(absent) {
            client.begin((checkpoint, size), prove, &self.answers);
        }
        Ok(())
    }

    /// Asks the witnesses due now whether the log goes on from what they have cosigned. `checkpoint` is its newest one. Returns how many
    /// know.
    ///
    /// # Errors
    /// A witness has cosigned more entries, or others.
    pub fn continues(
        &self,
        checkpoint: &[u8],
        prove: &ConsistencyProver,
    ) -> Result<usize, CosigningError> {
        let size = Parsed::read(checkpoint)?.checkpoint.size;
        let due: Vec<_> = self.compared().filter(|client| client.is_due()).collect();
        let answers: Vec<_> = thread::scope(|scope| {
            let ask = |client: &&Arc<CosigningClient>| {
                let (client, here) = (Arc::clone(client), Span::current());
                scope.spawn(move || {
                    let _here = here.enter();
                    let span = info_span!("ask a witness", zk0.witness = client.witness.name);
                    span.in_scope(|| client.ask(checkpoint, size, prove))
                })
            };
            let asked: Vec<_> = due.iter().map(ask).collect();
            asked.into_iter().map(ScopedJoinHandle::join).collect()
        });
        let mut known = 0;
        for (client, answer) in due.into_iter().zip(answers) {
            let name = client.witness.name.clone();
            match answer {
                Ok(Ok(())) => known += 1,
                Ok(Err(why)) if why.contradicts() => {
                    return Err(CosigningError::OtherHistory { name, why })
                }
                Ok(Err(_)) => {}
                Err(panic) => resume_unwind(panic),
            }
        }
        Ok(known)
    }

    /// Asks all witnesses once whether they cosign this log, whatever they have cosigned. `checkpoint` is any that the log has signed.
    ///
    /// # Errors
    /// Too few do for the policy.
    pub fn know(&self, checkpoint: &[u8]) -> Result<(), CosigningError> {
        let answers: Vec<_> = thread::scope(|scope| {
            let ask = |client: &Arc<CosigningClient>| {
                let client = client.clone();
                scope.spawn(move || client.knows(checkpoint))
            };
            let asked: Vec<_> = self.clients.iter().map(ask).collect();
            let joined = asked.into_iter().map(ScopedJoinHandle::join);
            joined
                .map(|answer| answer.unwrap_or_else(|panic| resume_unwind(panic)))
                .collect()
        });
        let known: Vec<_> = answers.iter().map(Result::is_ok).collect();
        if self.policy.met_by(&known) {
            return Ok(());
        }
        let refused = self.clients.iter().zip(answers);
        let refused = refused.filter_map(|(client, answer)| {
            let why = answer.err()?;
            Some(format!("{} {why}", client.witness.name))
        });
        Err(CosigningError::NoQuorum {
            wanted: self.policy.to_string(),
            refused: refused.collect(),
        })
    }

    fn compared(&self) -> impl Iterator<Item = &Arc<CosigningClient>> {
        let clients = self.clients.iter();
        clients.filter(move |client| !self.ignored.contains(&client.witness.name))
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
        loop {
            let seen = self.answers.now();
            let signed = self.clients.iter().map(|client| client.signed(checkpoint));
            let signed: Vec<_> = signed.collect();
            let cosigned: Vec<_> = signed.iter().map(Option::is_some).collect();
            if enough(&cosigned) {
                let (mut note, mut cosignatures) = (checkpoint.to_vec(), Vec::new());
                for one in signed.into_iter().flatten() {
                    note.extend(one.line);
                    cosignatures.push(one.cosignature);
                }
                return Ok(Cosigned { note, cosignatures });
            }
            let clients = self.clients.iter().zip(cosigned);
            let missing = clients.filter_map(|(client, cosigned)| (!cosigned).then_some(client));
            let missing: Vec<_> = missing.collect();
            let mut asked = false;
            for client in &missing {
                asked |= client.begin((checkpoint, size), prove, &self.answers);
            }
            if !asked || !self.answers.wait(seen, until) {
                let refused = missing.iter().map(|client| {
                    let WitnessState { name, outage, .. } = client.state();
                    let why = outage.map(|outage| outage.why);
                    format!(
                        "{name} {}",
                        why.as_deref().unwrap_or("has not answered yet")
                    )
                });
                let refused = refused.collect();
                return Err(CosigningError::NoQuorum { wanted, refused });
            }
        }
    }
}
