//! Takes part in a network: prepares the recording, and then trains, commits, proves and submits in each round.

use crate::client::{Decision, Node, OpenRound};
use crate::client_error::NodeError;
use crate::error::ParticipantError;
use crate::recording::Recording;
use crate::turn::{Entered, Training, Turn};
use crate::{receipts, state_files};
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Digest, Mode};
use zk0_files::atomic_file::put_in_place;
use zk0_protocol::counted::counted;
use zk0_protocol::entries::program::{Program, OUR_SP1};
use zk0_prover::service::ProvingClient;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::PolicyConfig;

/// Largest policy file that a node downloads. The published policy takes 1.8 GB.
pub const MAX_POLICY_BYTES: u64 = 4 << 30;

/// Who takes part, and with what.
pub struct Participant {
    /// The recording: a LeRobotDataset folder.
    pub dataset: PathBuf,
    /// Where the node keeps the policy, its salt, its updates, its training histories and its receipts.
    pub state: PathBuf,
    /// Where prepared samples are kept when the node ends.
    pub cache: Option<DiskCache>,
}

impl Participant {
    /// Fetches the network's policy, prepares the recording, and puts its commitment on the ledger.
    ///
    /// # Errors
    /// The network proves with another program, the policy does not fit its evaluation specification, or the recording, the
    /// aggregator or the file system fails.
    async fn enter(&self, node: &mut Node) -> Result<Entered, ParticipantError> {
        let program = node.program().await?;
        check_program(node.genesis().mode, program)?;
        let genesis = node.genesis();
        let spec = EvalSpec::decode(&genesis.evaluation)?;
        let blob = genesis.policy;
        let file = self.policy(node, &blob).await?;
        let config = file.policy.config.clone();
        check_dimensions(&config, &spec)?;
        tracing::info!("preparing the recording {}", self.dataset.display());
        let recording = self.recording(&file, &spec)?;
        // The frozen half is not needed any more. At the published size this frees 1.4 GB of memory.
        drop(file);
        receipts::keep(&self.state, node.register(&recording).await?)?;
        tracing::info!(
            "committed to {} samples, root {}",
            recording.commitment.samples,
            recording.commitment.root
        );
        Ok(Entered {
            config,
            spec,
            recording,
        })
    }

    /// Takes part in `rounds` rounds. If the update of a round cannot be proven, or is refused, the node goes on with the next round.
    pub async fn run(
        &self,
        node: &mut Node,
        prover: &mut ProvingClient,
        training: &Training,
        rounds: u64,
    ) -> Result<(), ParticipantError> {
        let play = async |turn: &Turn<'_>, node: &mut Node| turn.play(training, node, prover).await;
        self.rounds(node, rounds, play).await
    }

    /// Takes part in `rounds` rounds, as `play` does it. It ends before a round whose proofs are of another program than this release's.
    pub async fn rounds(
        &self,
        node: &mut Node,
        rounds: u64,
        mut play: impl AsyncFnMut(&Turn<'_>, &mut Node) -> Result<Decision, ParticipantError>,
    ) -> Result<(), ParticipantError> {
        let entered = self.enter(node).await?;
        let mut next = 0;
        for _ in 0..rounds {
            let OpenRound { opened, program } = node.wait_for_round(next).await?;
            // A vote may have changed the program since the last round.
            check_program(node.genesis().mode, program)?;
            let round = opened.round;
            next = round + 1;
            let turn = Turn {
                state: &self.state,
                entered: &entered,
                opened: &opened,
            };
            match play(&turn, node).await.map(|decision| decision.refusal) {
                Ok(None) => tracing::info!("round {round}: accepted"),
                Ok(Some(reason)) => tracing::warn!("round {round}: refused: {reason}"),
                Err(ParticipantError::Statement(error)) => tracing::warn!(
                    "round {round}: the update cannot be proven and is not submitted: {error}"
                ),
                Err(error) => return Err(error),
            }
            let closed = node.wait_for_close(round).await?;
            let count = closed.contributors.len() as u64;
            let averaged = counted(
                count,
                "contribution was averaged",
                "contributions were averaged",
            );
            tracing::info!("round {round} has closed, and {averaged}");
        }
        Ok(())
    }

    /// The network's policy. The first start downloads it, and it stays on disk. It may have 1.8 GB, so it is never in memory twice.
    async fn policy(&self, node: &mut Node, blob: &Digest) -> Result<PolicyFile, ParticipantError> {
        let path = self.state.join(format!("policy-{blob}.safetensors"));
        if state_files::sha256(&path)? != Some(blob.0) {
            let unfinished = path.with_extension("unfinished");
            let file = File::create(&unfinished).map_err(state_files::at(&unfinished))?;
            let mut out = BufWriter::new(&file);
            match node.download_to(blob, MAX_POLICY_BYTES, &mut out).await {
                Err(NodeError::Write(error)) => return Err(state_files::at(&unfinished)(error)),
                downloaded => downloaded?,
            }
            drop(out);
            put_in_place(&file, &unfinished, &path).map_err(state_files::at(&path))?;
        }
        Ok(policy_file::load(&path)?)
    }

    /// The prepared recording. Its salt stays the same when the node is started again.
    fn recording(&self, file: &PolicyFile, spec: &EvalSpec) -> Result<Recording, ParticipantError> {
        let path = self.state.join("salt");
        let salt = match state_files::read(&path, 32)? {
            Some(bytes) => match <[u8; 32]>::try_from(&bytes[..]) {
                Ok(salt) => salt,
                Err(_) => {
                    let why = format!("{} bytes instead of 32", bytes.len());
                    return Err(ParticipantError::BrokenFile { path, why });
                }
            },
            None => {
                let mut salt = [0; 32];
                getrandom::fill(&mut salt).map_err(ParticipantError::Random)?;
                state_files::write(&path, &salt)?;
                salt
            }
        };
        Recording::prepare(&self.dataset, file, spec, salt, self.cache.as_ref())
    }
}

/// Checks that the network proves with the program that this release has. With another one, the node would train and prove in vain.
fn check_program(mode: Mode, needed: Program) -> Result<(), ParticipantError> {
    let own = Program {
        key: verifying_key(mode).to_vec(),
        sp1: OUR_SP1.into(),
    };
    match needed == own {
        true => Ok(()),
        false => Err(ParticipantError::OtherProgram { needed, own }),
    }
}

/// Checks that the node trains and proves at the same dimensions. Otherwise it would fail only after minutes of work.
fn check_dimensions(config: &PolicyConfig, spec: &EvalSpec) -> Result<(), ParticipantError> {
    match dims(config)? == spec.dims {
        true => Ok(()),
        false => Err(ParticipantError::Dimensions),
    }
}
