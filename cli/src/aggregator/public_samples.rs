//! Samples on which a network evaluates each round's result before it takes it, made from recordings.

use crate::blob_store::BlobStoreOptions;
use crate::dataset::RecordingName;
use crate::output::println;
use crate::policy::calibration::samples_of;
use anyhow::{bail, Context, Result};
use std::path::{Path, PathBuf};
use zk0_aggregator::round::founding::check_public_samples;
use zk0_circuits::EvalSpec;
use zk0_files::bounded_file;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::store::Store;
use zk0_ledger::{folder, LedgerError};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::rules::closing::public_samples::{PublicSamples, MAX_PUBLIC_SAMPLES_BYTES};
use zk0_smolvla::measure::fixed_point::quantise_sample;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};

/// How many frames of recordings are evaluated, and how much worse a result may be there.
#[derive(Debug, clap::Args)]
pub struct Extent {
    /// Use this many frames, evenly spread over the recordings. Each round evaluates them twice.
    #[arg(long, value_name = "COUNT", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1024))]
    public_frames: u32,
    /// Do not take the result of a round if its loss on these frames is larger than that of the round's base by more than this many basis
    /// points (100 are 1 %).
    #[arg(long, value_name = "BPS", default_value_t = 500)]
    max_loss_increase_bps: u32,
}

/// The public samples of a network that is founded.
#[derive(Debug, clap::Args)]
pub struct PublicSampleOptions {
    /// Evaluate the result of each round on frames of this recording before it is taken (a LeRobotDataset folder, or
    /// hub:owner/name[@revision]). A task that no node trains on is best. Everybody can read these frames, as numbers of the frozen half
    /// of the policy. Repeat the option for more recordings. Without it, every result is taken.
    /// A policy of the published size needs it.
    #[arg(long = "public-recording", value_name = "RECORDING")]
    recordings: Vec<RecordingName>,
    /// The file of public samples that the rules of --rules name.
    #[arg(
        long,
        value_name = "FILE",
        requires = "rules",
        conflicts_with = "recordings"
    )]
    public_samples: Option<PathBuf>,
    /// Found a network of a large policy without public samples. One harmful update can then spoil the weights for all, and no claim
    /// shows it.
    #[arg(long, conflicts_with_all = ["recordings", "public_samples"])]
    without_public_samples: bool,
    #[command(flatten)]
    extent: Extent,
}

/// Policies with so many expert weights need public samples, unless the founder declines. The published size has 98 million.
const LARGE: usize = 10_000_000;

/// `zk0 aggregator samples`.
#[derive(Debug, clap::Args)]
pub struct MakeSamples {
    /// The ledger's folder.
    dir: PathBuf,
    /// Use frames of this recording (a LeRobotDataset folder, or hub:owner/name[@revision]). Repeat the option for more recordings.
    #[arg(long = "public-recording", value_name = "RECORDING", required = true)]
    recordings: Vec<RecordingName>,
    #[command(flatten)]
    extent: Extent,
    #[command(flatten)]
    store: BlobStoreOptions,
}

impl PublicSampleOptions {
    /// Refuses so large a policy without public samples, unless that was asked for.
    pub fn check(&self, weights: usize, named: Option<&PublicSamples>) -> Result<()> {
        if weights < LARGE
            || named.is_some()
            || self.without_public_samples
            || !self.recordings.is_empty()
        {
            return Ok(());
        }
        bail!(
            "a network of a policy with {weights} expert weights needs public samples, on which the result of each round is evaluated before it \
             becomes the new global weights: add --public-recording with a recording that no node has, or --without-public-samples"
        )
    }

    /// The samples' recordings.
    pub fn recordings(&self) -> &[RecordingName] {
        &self.recordings
    }

    /// The rule and its file. `named` is the rule in a file of rules.
    pub fn samples(
        &self,
        named: Option<PublicSamples>,
        policy: &PolicyFile,
        spec: &EvalSpec,
    ) -> Result<Option<(PublicSamples, Vec<u8>)>> {
        match (named, &self.public_samples, &self.recordings[..]) {
            (None, None, []) => Ok(None),
            (None, None, recordings) => self.extent.make(recordings, policy, spec).map(Some),
            (Some(rule), Some(path), _) => {
                let file = bounded_file::read(path, MAX_PUBLIC_SAMPLES_BYTES)
                    .with_context(|| format!("reading public samples from {}", path.display()))?;
                Ok(Some((rule, file)))
            }
            (Some(rule), None, _) => bail!(
                "the rules name the public samples {}: add --public-samples FILE with that file, or leave public_samples out of the rules \
                 and add --public-recording",
                rule.blob
            ),
            (None, Some(_), _) => {
                bail!("the rules name no public samples: --public-samples is for rules that do")
            }
        }
    }
}

impl Extent {
    fn make(
        &self,
        recordings: &[RecordingName],
        policy: &PolicyFile,
        spec: &EvalSpec,
    ) -> Result<(PublicSamples, Vec<u8>)> {
        tracing::info!("preparing the public samples");
        let (frames, among) = (self.public_frames as usize, recordings.len());
        let share = |place: usize| frames / among + usize::from(place < frames % among);
        let shares = recordings.iter().zip((0..among).map(share));
        let (mut file, mut count) = (Vec::new(), 0);
        for prepared in samples_of(policy, shares)? {
            let sample = quantise_sample(spec, &prepared)
                .with_context(|| format!("public sample {count} in fixed point"))?;
            file.extend_from_slice(sample.as_bytes());
            count += 1;
        }
        if file.len() as u64 > MAX_PUBLIC_SAMPLES_BYTES {
            bail!(
                "{count} public samples of this policy have {} bytes, and at most {MAX_PUBLIC_SAMPLES_BYTES} are possible: use fewer frames",
                file.len()
            );
        }
        let rule = PublicSamples {
            blob: blob_digest(&file),
            samples: count,
            max_loss_increase_bps: self.max_loss_increase_bps,
        };
        rule.check().map_err(anyhow::Error::msg)?;
        check_public_samples(spec, &rule, &file)?;
        tracing::info!(
            "{count} public samples, {} bytes: {}",
            file.len(),
            rule.blob
        );
        Ok((rule, file))
    }
}

/// Makes samples for an existing network, adds them to its ledger's blobs, and prints the rule to propose.
pub fn make(options: &MakeSamples) -> Result<()> {
    if !folder::database(&options.dir).exists() {
        bail!(LedgerError::NoLedger(options.dir.clone()));
    }
    let kept = options.store.blobs_beside_writer(&options.dir)?;
    let (policy, spec) = founded(&options.dir, &kept)?;
    let (rule, file) = options.extent.make(&options.recordings, &policy, &spec)?;
    // When the rule is proposed, the aggregator puts it into the blobs' store.
    Blobs::at(&options.dir).put(&file)?;
    let rules = serde_json::json!({ "public_samples": rule });
    println!("{}", serde_json::to_string_pretty(&rules)?);
    Ok(())
}

fn founded(dir: &Path, blobs: &Blobs) -> Result<(PolicyFile, EvalSpec)> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let entry = store.entry(0)?.context("the ledger has no genesis")?;
    let Body::Genesis(genesis) = Entry::decode(&entry)?.body else {
        bail!("the ledger's first entry is not a genesis");
    };
    blobs.check(&genesis.policy)?;
    let policy = policy_file::load(&blobs.path(&genesis.policy))?;
    Ok((policy, EvalSpec::decode(&genesis.evaluation)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_policy_needs_public_samples_unless_its_founder_asks_for_none() {
        let options = |recordings: &[&str], without_public_samples| PublicSampleOptions {
            recordings: recordings
                .iter()
                .map(|name| name.parse().unwrap())
                .collect(),
            public_samples: None,
            without_public_samples,
            extent: Extent {
                public_frames: 1,
                max_loss_increase_bps: 1,
            },
        };
        let named = PublicSamples {
            blob: Default::default(),
            samples: 1,
            max_loss_increase_bps: 1,
        };
        let refused = options(&[], false).check(LARGE, None).unwrap_err();
        assert!(refused.to_string().contains("add --public-recording"));
        assert!(options(&[], false).check(LARGE - 1, None).is_ok());
        assert!(options(&[], false).check(LARGE, Some(&named)).is_ok());
        assert!(options(&["so100_sorting"], false)
            .check(LARGE, None)
            .is_ok());
        assert!(options(&[], true).check(LARGE, None).is_ok());
    }
}
