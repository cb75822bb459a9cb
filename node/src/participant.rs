//! Takes part in a network: registers the recording, and then trains, commits, proves and submits in each round.

use crate::client::watching::{OpenRound, Waited};
use crate::client::NodeClient;
use crate::client_error::NodeError;
use crate::error::ParticipantError;
use crate::observe::NodePhase;
use crate::recording::registering::Registering;
use crate::recording::OpenRecording;
use crate::state_files::{self, lock::StateLock};
use crate::turn::{unfinished, Entered, LocalTraining, Turn};
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use zk0_argument::claim::most_samples;
use zk0_circuits::model::spec::EvalSpec;
use zk0_files::atomic_file::put_in_place;
use zk0_lerobot::dataset::{Dataset, RenameMap};
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::RoundOpened;
use zk0_protocol::entries::refusal::Refusal;
use zk0_protocol::entries::round_result::ResultOutcome;
use zk0_protocol::rpc::federation::{turned_down::Remedy, TurnedDown};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_prover::service::ProvingClient;
use zk0_smolvla::frames::image_transforms::Variants;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::PolicyConfig;
use zk0_weights::Format;

/// The published policy takes 1.8 GB.
pub const MAX_POLICY_BYTES: u64 = 4 << 30;

/// Who takes part, and with what.
pub struct Participant {
    /// The recording: a LeRobotDataset folder.
    pub dataset: PathBuf,
    /// The network's names of the recording's cameras.
    pub rename_map: RenameMap,
    /// Folder of what the node keeps.
    pub state: PathBuf,
    /// Where prepared samples stay when the node ends.
    pub cache: Option<DiskCache>,
    /// Samples per claim; `None` for the fewest that the rules allow.
    pub eval_samples: Option<u32>,
    /// Transformed variants of frames for training only.
    pub variants: Option<Variants>,
    /// Keeps other nodes from the state folder.
    pub lock: StateLock,
}

impl Participant {
    /// Waits until the node has the network's program, fetches the policy, and opens the recording.
    ///
    /// # Errors
    /// The recording, the aggregator or the file system fails.
    async fn open(&self, node: &mut NodeClient) -> Result<OpenRecording<'_>, ParticipantError> {
        node.wait_for_program().await?;
        let policy = self.policy(node).await?;
        tracing::info!("opening the recording {}", self.dataset.display());
        let dataset = Dataset::open(&self.dataset)?.renamed(&self.rename_map)?;
        OpenRecording::of(dataset, &policy, self.cache.as_ref())
    }

    /// Takes part in `rounds` rounds. After an update that cannot be proven, is refused, or comes too late, the node goes on with the next
    /// round.
    pub async fn run(
        &self,
        node: &mut NodeClient,
        prover: &mut ProvingClient,
        training: &LocalTraining,
        rounds: u64,
    ) -> Result<(), ParticipantError> {
        let play =
            async |turn: &Turn<'_>, node: &mut NodeClient| turn.play(training, node, prover).await;
        self.rounds(node, rounds, play).await
    }

    /// Takes part in `rounds` rounds by `play`. Waits before a round whose guest program it lacks. Ends before a round with rules that ask
    /// for other recordings.
    pub async fn rounds(
        &self,
        node: &mut NodeClient,
        rounds: u64,
        mut play: impl AsyncFnMut(
            &Turn<'_>,
            &mut NodeClient,
        ) -> Result<Option<Refusal>, ParticipantError>,
    ) -> Result<(), ParticipantError> {
        state_files::remove_unfinished(&self.state)?;
        let recording = self.open(node).await?;
        // A registration stays on the ledger, so the check comes first.
        recording.check(&node.governance().await?.rules.recordings)?;
        let maker = recording.maker().with_variants(self.variants.clone());
        let samples = recording.samples(&maker);
        let training = recording.training_samples(&maker, self.variants.as_ref());
        let spec = EvalSpec::decode(&node.genesis().evaluation)?;
        check_dimensions(recording.config(), &spec)?;
        let registering = Registering {
            state: &self.state,
            recording: &recording,
            samples: &samples,
            spec: &spec,
        };
        let mut entered = Entered {
            config: recording.config(),
            format: Format::new(&spec)?,
            samples: &samples,
            training: &training,
            evaluation: registering.enter(node).await?,
            registering: &registering,
        };
        let most = most_samples(node.genesis().mode, &spec);
        let metrics = node.metrics().clone();
        let mut next = 0;
        for _ in 0..rounds {
            metrics.enters(NodePhase::Waiting);
            // A vote may have changed program and rules since the last round.
            let OpenRound { opened, program } = node.wait_for_provable_round(next).await?;
            recording.check(&opened.rules.recordings)?;
            let round = opened.round;
            metrics.begins(round);
            next = round + 1;
            let present = &entered.evaluation;
            if let Some(other) = registering.of_round(node, round, present).await? {
                entered.evaluation = other;
            }
            let held = entered.evaluation.commitment.samples;
            let turn = Turn {
                state: &self.state,
                entered: &entered,
                opened: &opened,
                program: &program,
                eval_samples: eval_samples(self.eval_samples, &opened, held, most)?,
            };
            let played = play(&turn, node).await;
            let accepted = matches!(played, Ok(None));
            match &played {
                Ok(refusal) => metrics.decided(refusal.as_ref()),
                Err(_) => metrics.missed(),
            }
            match played {
                Ok(None) => tracing::info!("round {round}: accepted"),
                Ok(Some(reason)) => tracing::warn!("round {round}: refused: {reason}"),
                // If only a file has failed, the node ends. At its next start it goes on with its update.
                Err(ParticipantError::NotProvable(error)) if !error.may_pass() => tracing::warn!(
                    "round {round}: the update cannot be proven and is not submitted: {error}"
                ),
                Err(error @ ParticipantError::WornOut { .. }) => {
                    tracing::warn!("round {round}: {error}");
                }
                Err(ParticipantError::Node(error @ NodeError::NoRandomness { .. })) => {
                    tracing::warn!("{error}");
                }
                Err(
                    error @ (ParticipantError::NoControlVariates { .. }
                    | ParticipantError::TooLate { .. }
                    | ParticipantError::NoProofInTime { .. }),
                ) => {
                    tracing::warn!("{error}");
                }
                // The base or the rules may be to blame. Neither may end the nodes.
                Err(error) if error.is_of_training() => {
                    let rates = match opened.rules.strategy {
                        Strategy::Scaffold(_) => {
                            " (the rules state how this round is trained, and a vote changes them)"
                        }
                        _ => "",
                    };
                    tracing::warn!(
                        "round {round}: the training gave no update, and the node goes on with the next round: {error}{rates}"
                    );
                }
                // The round is full or over for this node, or an answer and the node's files were lost.
                Err(ParticipantError::Node(NodeError::Refused(status)))
                    if TurnedDown::of(&status).remedy() == Remedy::NextRound =>
                {
                    let why = status.message();
                    tracing::warn!("round {round}: the node goes on with the next round: {why}");
                }
                Err(error) => return Err(error),
            }
            metrics.enters(NodePhase::Closing);
            let mut watch = node.until_closed(round);
            let closed = loop {
                match node.wait_for_close(&mut watch).await? {
                    Waited::Closed(closed) => break *closed,
                    Waited::Lost => {
                        if let Err(error) = turn.send_again(node).await {
                            tracing::error!("round {round}: a file that the aggregator has lost cannot be sent again: {error}");
                        }
                    }
                }
            };
            unfinished::remove(&self.state)?;
            let counts = closed.contributors.iter().any(|one| one.node == node.id());
            if accepted && !counts {
                tracing::error!("round {round} has closed without the contribution of this node, which it had accepted: the aggregator has lost a file of it");
            }
            let count = closed.contributors.len() as u64;
            let averaged = counted(
                count,
                "contribution was averaged",
                "contributions were averaged",
            );
            tracing::info!("round {round} has closed, and {averaged}");
            if let Some(evaluated) = &closed.evaluated {
                let (before, after) = evaluated.means(entered.format.spec().action);
                let loss =
                    |loss: Option<f64>| loss.map_or("overflow".into(), |loss| format!("{loss:.4}"));
                let losses = format!("{} -> {}", loss(before), loss(after));
                match evaluated.outcome {
                    ResultOutcome::Taken => tracing::info!(
                        "round {round}: the average was taken; loss on the public samples: {losses}"
                    ),
                    outcome => tracing::warn!(
                        "round {round}: {outcome}; loss on the public samples: {losses}; nobody earns credits"
                    ),
                }
            }
        }
        Ok(())
    }

    /// The network's policy. The first start downloads it.
    async fn policy(&self, node: &mut NodeClient) -> Result<PathBuf, ParticipantError> {
        let blob = &node.genesis().policy.clone();
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
        Ok(path)
    }
}

/// Samples of a claim in this round: `asked`, or as few as the rules allow. The node has `held`, and a claim at most `most`. A wrong number
/// would be refused only after the training.
fn eval_samples(
    asked: Option<u32>,
    opened: &RoundOpened,
    held: u64,
    most: u32,
) -> Result<u32, ParticipantError> {
    let (least, allowed) = (opened.rules.min_eval_samples, opened.rules.max_eval_samples);
    let asked = asked.unwrap_or(least);
    match (least..=allowed).contains(&asked) && u64::from(asked) <= held {
        true if asked > most => Err(ParticipantError::TooManyToProve { asked, most }),
        true => Ok(asked),
        false => Err(ParticipantError::EvalSamples {
            round: opened.round,
            asked,
            least,
            allowed,
            held,
        }),
    }
}

/// Otherwise the node would fail only after minutes of work.
fn check_dimensions(config: &PolicyConfig, spec: &EvalSpec) -> Result<(), ParticipantError> {
    if dims(config)? == spec.dims {
        Ok(())
    } else {
        Err(ParticipantError::Dimensions)
    }
}
