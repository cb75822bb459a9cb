//! The data of simulated nodes: a recording each, or episodes dealt out.

use crate::robots::error::SimulationError;
use sha2::{Digest as _, Sha256};
use std::ops::Range;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording::prepare_samples;
use zk0_protocol::counted::counted;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::evaluate::{fixed_draws, FlowDraw};
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::split::Split;

/// A node's data, in memory.
pub struct NodeData {
    /// The node's name.
    pub name: String,
    /// Its recordings' names.
    pub recordings: Vec<String>,
    /// The episodes for losses only, such as `so100_pickplace episode 3`.
    pub held_out: Vec<String>,
    /// The frames to train on.
    pub trained_on: Vec<PreparedSample>,
    /// The frames to measure losses on.
    pub evaluated: Vec<PreparedSample>,
    /// Noise and time for each of these, in all rounds.
    pub draws: Vec<FlowDraw>,
}

/// How data is dealt to nodes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Dealing {
    /// Nodes; `None` for one per recording.
    pub nodes: Option<usize>,
    /// The held-out share of a node's episodes.
    pub held_out: f64,
    /// The share set aside before, for neither: those that this share and the same seed hold out.
    pub set_aside: f64,
    /// Most frames per node for losses.
    pub evaluated: usize,
    /// Chooses held-out episodes, noise and times.
    pub seed: u64,
}

/// A recording with samples of all frames.
pub struct SampledRecording {
    /// Its folder's name.
    pub name: String,
    /// Its episodes' digest.
    pub digest: [u8; 32],
    /// Each episode's digest.
    pub episode_digests: Vec<[u8; 32]>,
    episodes: Vec<Range<usize>>,
    samples: Vec<PreparedSample>,
}

impl SampledRecording {
    /// Makes samples of all frames with the policy of `file`.
    ///
    /// # Errors
    /// A frame cannot be read.
    pub fn of(
        dataset: &Dataset,
        file: &PolicyFile,
        cache: Option<&DiskCache>,
    ) -> Result<Self, SimulationError> {
        let root = dataset.root();
        let name = root.file_name().unwrap_or(root.as_os_str());
        let episode_digests: Vec<_> = dataset.episode_digests().collect();
        let episodes = dataset.episodes().iter();
        Ok(Self {
            digest: Sha256::digest(episode_digests.concat()).into(),
            episode_digests,
            name: name.to_string_lossy().into_owned(),
            episodes: episodes.map(|episode| episode.frames.clone()).collect(),
            samples: prepare_samples(dataset, file, cache)?,
        })
    }
}

type Dealt = (usize, usize);

/// Deals the recordings out to nodes.
///
/// # Errors
/// There are fewer episodes than nodes, or a node has too few to divide.
pub fn deal(
    recordings: &[SampledRecording],
    file: &PolicyFile,
    dealing: &Dealing,
) -> Result<Vec<NodeData>, SimulationError> {
    let shares = shares(recordings, dealing.nodes)?;
    let nodes = shares.into_iter().enumerate().map(|(number, episodes)| {
        let name = format!("node-{}", number + 1);
        let mut names: Vec<_> = episodes.iter().map(|(recording, _)| *recording).collect();
        names.dedup();
        let names = names
            .iter()
            .map(|recording| recordings[*recording].name.clone());
        let names: Vec<_> = names.collect();
        let (train, held_out) = divided(&episodes, dealing, &name, &names)?;
        let trained_on = frames(recordings, &train);
        let evaluated = if held_out.is_empty() {
            spread(&trained_on, dealing.evaluated)
        } else {
            spread(&frames(recordings, &held_out), dealing.evaluated)
        };
        let held_out = held_out.iter().map(|(recording, episode)| {
            format!("{} episode {episode}", recordings[*recording].name)
        });
        Ok(NodeData {
            name,
            recordings: names,
            held_out: held_out.collect(),
            draws: fixed_draws(&file.policy.config, evaluated.len(), dealing.seed),
            trained_on,
            evaluated,
        })
    });
    nodes.collect()
}

/// A recording that no node has.
pub fn unseen(recorded: &SampledRecording, file: &PolicyFile, dealing: &Dealing) -> NodeData {
    let evaluated = spread(&recorded.samples, dealing.evaluated);
    NodeData {
        name: recorded.name.clone(),
        recordings: vec![recorded.name.clone()],
        held_out: Vec::new(),
        trained_on: Vec::new(),
        draws: fixed_draws(&file.policy.config, evaluated.len(), dealing.seed),
        evaluated,
    }
}

fn divided(
    episodes: &[Dealt],
    dealing: &Dealing,
    name: &str,
    recordings: &[String],
) -> Result<(Vec<Dealt>, Vec<Dealt>), SimulationError> {
    let parts = [
        (dealing.set_aside > 0.0, "one to set aside"),
        (dealing.held_out > 0.0, "one to measure losses on"),
        (true, "one to train on"),
    ];
    let needed: Vec<_> = parts.iter().filter(|part| part.0).map(|p| p.1).collect();
    if episodes.len() < needed.len() {
        return Err(SimulationError::Data(format!(
            "{name} has {} of {}, and needs {} episodes: {}. Name longer recordings, or simulate fewer nodes",
            counted(episodes.len() as u64, "episode", "episodes"),
            recordings.join(", "),
            needed.len(),
            needed.join(", ")
        )));
    }
    let of = |from: &[Dealt], chosen: &[usize]| -> Vec<Dealt> {
        chosen.iter().map(|place| from[*place]).collect()
    };
    let rest = of(
        episodes,
        &Split::of(episodes.len(), dealing.set_aside, dealing.seed)?.train,
    );
    let split = Split::of(rest.len(), dealing.held_out, dealing.seed)?;
    Ok((of(&rest, &split.train), of(&rest, &split.eval)))
}

/// With a number of nodes, episode `i` of all recordings goes to node `i % nodes`.
fn shares(
    recordings: &[SampledRecording],
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

fn frames(recordings: &[SampledRecording], episodes: &[Dealt]) -> Vec<PreparedSample> {
    let frames = episodes.iter().flat_map(|(recording, episode)| {
        let recording = &recordings[*recording];
        &recording.samples[recording.episodes[*episode].clone()]
    });
    frames.cloned().collect()
}

fn spread(samples: &[PreparedSample], most: usize) -> Vec<PreparedSample> {
    let count = samples.len().min(most.max(1));
    let places = (0..count).map(|number| number * samples.len() / count);
    places.map(|place| samples[place].clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use zk0_smolvla::policy::init::init_policy;
    use zk0_smolvla::Profile;

    fn recorded(name: &str, episodes: usize) -> SampledRecording {
        let frame = |number: usize| PreparedSample {
            prefix_tokens: 1,
            keys: Vec::new(),
            values: Vec::new(),
            actions: vec![number as f32],
            is_pad: Vec::new(),
        };
        SampledRecording {
            name: name.into(),
            digest: [0; 32],
            episode_digests: vec![[0; 32]; episodes],
            episodes: (0..episodes).map(|one| 3 * one..3 * one + 3).collect(),
            samples: (0..3 * episodes).map(frame).collect(),
        }
    }

    fn dealt(
        recordings: &[SampledRecording],
        dealing: &Dealing,
    ) -> Result<Vec<NodeData>, SimulationError> {
        let policy = init_policy(&Profile::Micro.config(), 0).unwrap();
        deal(recordings, &PolicyFile::hashing_words(policy), dealing)
    }

    const DEALING: Dealing = Dealing {
        nodes: None,
        held_out: 0.2,
        set_aside: 0.0,
        evaluated: 100,
        seed: 5,
    };

    fn actions(samples: &[PreparedSample]) -> BTreeSet<u32> {
        let all = samples.iter().map(|sample| sample.actions[0] as u32);
        all.collect()
    }

    #[test]
    fn what_a_comparison_measures_on_is_set_aside_in_its_search() {
        let recordings = [recorded("a", 10), recorded("b", 3)];
        let compared = dealt(&recordings, &DEALING).unwrap();
        let searching = Dealing {
            set_aside: 0.2,
            ..DEALING
        };
        let searched = dealt(&recordings, &searching).unwrap();
        for (compared, searched) in compared.iter().zip(&searched) {
            assert!(!compared.held_out.is_empty() && !searched.held_out.is_empty());
            let reported = actions(&compared.evaluated);
            for other in [
                &searched.evaluated,
                &searched.trained_on,
                &compared.trained_on,
            ] {
                assert!(!other.is_empty());
                assert!(reported.is_disjoint(&actions(other)));
            }
            assert!(actions(&searched.evaluated).is_disjoint(&actions(&searched.trained_on)));
        }
    }

    #[test]
    fn a_node_with_too_few_episodes_is_named() {
        let refused = |episodes, set_aside| {
            let dealing = Dealing {
                set_aside,
                ..DEALING
            };
            let dealt = dealt(
                &[recorded("long", 9), recorded("short", episodes)],
                &dealing,
            );
            dealt.err().map(|error| error.to_string())
        };
        assert_eq!(refused(2, 0.0), None);
        assert_eq!(refused(3, 0.2), None);
        let reported = refused(1, 0.0).unwrap();
        assert!(reported.starts_with("node-2 has 1 episode of short, and needs 2 episodes: one to measure losses on, one to train on."), "{reported}");
        let reported = refused(2, 0.2).unwrap();
        assert!(
            reported.starts_with(
                "node-2 has 2 episodes of short, and needs 3 episodes: one to set aside"
            ),
            "{reported}"
        );
    }
}
