//! The data of simulated nodes: a recording each, or the episodes of some recordings, dealt out.

use crate::robots::error::SimulationError;
use sha2::{Digest as _, Sha256};
use std::ops::Range;
use std::path::Path;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording::prepare_samples;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate::{fixed_draws, FlowDraw};
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::split::Split;

/// What a node has. All of it is in memory.
pub struct NodeData {
    /// The node's name.
    pub name: String,
    /// The names of its recordings.
    pub recordings: Vec<String>,
    /// The frames that it trains on.
    pub trained_on: Vec<PreparedSample>,
    /// The frames that losses are measured on.
    pub evaluated: Vec<PreparedSample>,
    /// Noise and time for each of them, the same in all rounds.
    pub draws: Vec<FlowDraw>,
}

/// What data nodes get.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Dealing {
    /// The number of nodes; `None` for one per recording.
    pub nodes: Option<usize>,
    /// The share of each node's episodes that it does not train on.
    pub held_out: f64,
    /// The most frames of a node that losses are measured on.
    pub evaluated: usize,
    /// Chooses the held-out episodes, noise and times.
    pub seed: u64,
}

/// A recording, and all its frames as samples.
pub struct Recorded {
    /// The name of its folder.
    pub name: String,
    /// Digest of its episodes.
    pub digest: [u8; 32],
    episodes: Vec<Range<usize>>,
    samples: Vec<PreparedSample>,
}

impl Recorded {
    /// Opens the recording in `path`, and makes samples of its frames with the policy of `file`, as a node does.
    ///
    /// # Errors
    /// The recording cannot be read.
    pub fn open(
        path: &Path,
        file: &PolicyFile,
        cache: Option<&DiskCache>,
    ) -> Result<Self, SimulationError> {
        let dataset = Dataset::open(path).map_err(zk0_node::error::ParticipantError::from)?;
        let name = path.file_name().unwrap_or(path.as_os_str());
        let mut digest = Sha256::new();
        dataset.episode_digests().for_each(|one| digest.update(one));
        let episodes = dataset.episodes().iter();
        Ok(Self {
            digest: digest.finalize().into(),
            name: name.to_string_lossy().into_owned(),
            episodes: episodes.map(|episode| episode.frames.clone()).collect(),
            samples: prepare_samples(&dataset, file, cache)?,
        })
    }
}

/// An episode of a recording: the recording's number, and the episode's.
type Dealt = (usize, usize);

/// Deals the recordings out to nodes.
///
/// # Errors
/// There are fewer episodes than nodes, or the episodes of a node cannot be divided.
pub fn deal(
    recordings: &[Recorded],
    file: &PolicyFile,
    dealing: &Dealing,
) -> Result<Vec<NodeData>, SimulationError> {
    let shares = shares(recordings, dealing.nodes)?;
    let nodes = shares.into_iter().enumerate().map(|(number, episodes)| {
        let split = Split::of(episodes.len(), dealing.held_out, dealing.seed)?;
        let of = |chosen: &[usize]| {
            let chosen = chosen.iter().map(|place| episodes[*place]);
            frames(recordings, chosen)
        };
        let trained_on = of(&split.train);
        let evaluated = match split.eval.is_empty() {
            true => spread(&trained_on, dealing.evaluated),
            false => spread(&of(&split.eval), dealing.evaluated),
        };
        let mut names: Vec<_> = episodes.iter().map(|(recording, _)| *recording).collect();
        names.dedup();
        let names = names
            .iter()
            .map(|recording| recordings[*recording].name.clone());
        Ok(NodeData {
            name: format!("node-{}", number + 1),
            recordings: names.collect(),
            draws: fixed_draws(&file.policy.config, evaluated.len(), dealing.seed),
            trained_on,
            evaluated,
        })
    });
    nodes.collect()
}

/// A recording that no node has, to measure losses on.
pub fn unseen(recorded: &Recorded, file: &PolicyFile, dealing: &Dealing) -> NodeData {
    let evaluated = spread(&recorded.samples, dealing.evaluated);
    NodeData {
        name: recorded.name.clone(),
        recordings: vec![recorded.name.clone()],
        trained_on: Vec::new(),
        draws: fixed_draws(&file.policy.config, evaluated.len(), dealing.seed),
        evaluated,
    }
}

/// The episodes of each node. With a number of nodes, the episodes of all recordings are counted through, and number `i` goes to node
/// `i % nodes`.
fn shares(
    recordings: &[Recorded],
    nodes: Option<usize>,
) -> Result<Vec<Vec<Dealt>>, SimulationError> {
    let episodes =
        |number: usize| (0..recordings[number].episodes.len()).map(move |one| (number, one));
    let all = 0..recordings.len();
    let Some(nodes) = nodes else {
        return Ok(all.map(|number| episodes(number).collect()).collect());
    };
    let all: Vec<Dealt> = all.flat_map(episodes).collect();
    if all.len() < nodes {
        return Err(SimulationError::Data(format!(
            "{nodes} nodes need {nodes} episodes, and the recordings have {}: name more recordings, or simulate fewer nodes",
            all.len()
        )));
    }
    let mut shares = vec![Vec::new(); nodes];
    for (number, episode) in all.into_iter().enumerate() {
        shares[number % nodes].push(episode);
    }
    Ok(shares)
}

fn frames(recordings: &[Recorded], episodes: impl Iterator<Item = Dealt>) -> Vec<PreparedSample> {
    let frames = episodes.flat_map(|(recording, episode)| {
        let recording = &recordings[recording];
        &recording.samples[recording.episodes[episode].clone()]
    });
    frames.cloned().collect()
}

/// At most `most` samples, evenly spread.
fn spread(samples: &[PreparedSample], most: usize) -> Vec<PreparedSample> {
    let count = samples.len().min(most.max(1));
    let places = (0..count).map(|number| number * samples.len() / count);
    places.map(|place| samples[place].clone()).collect()
}
