//! `zk0 aggregator init`: found a network on a policy.

use super::{
    enrol,
    rules::{CommonRules, LEAST_UPDATE_LIMIT},
    Enrolment,
};
use crate::{
    calibration::{calibrated, samples},
    dataset::RecordingName,
    governance::read_rules,
    keys,
    policy_source::PolicySource,
};
use anyhow::{bail, Context, Result};
use std::{
    io::{self, BufWriter, Write},
    path::PathBuf,
};
use zk0_aggregator::round::clock::{Clock, SystemClock};
use zk0_circuits::{
    claim::program::verifying_key, model::spec::EvalSpec, Digest, Mode, WeightsDigest,
};
use zk0_ledger::{
    blobs::{BlobWriter, Blobs},
    error::LedgerError,
    folder,
    log::Ledger,
};
use zk0_node::participant::MAX_POLICY_BYTES;
use zk0_protocol::{entries::genesis::Genesis, rules::network_rules::Rules};
use zk0_smolvla::{
    measure::fixed_point::{dims, quantise_weights},
    policy::policy_file::PolicyFile,
    Policy, Profile,
};

/// `zk0 aggregator init`.
#[derive(Debug, clap::Args)]
pub struct Init {
    /// The ledger's directory; must not exist.
    dir: PathBuf,
    /// The network's name, also the origin of its checkpoints.
    #[arg(long)]
    name: String,
    /// The log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// Nodes to enrol: NAME=IDENTITY.
    #[arg(long = "node")]
    nodes: Vec<Enrolment>,
    /// How matrix products are proven: direct (the guest multiplies) or checked (it checks products with random
    /// coefficients, and verifiers project the weights; the only way at the published size).
    #[arg(long, default_value = "direct")]
    mode: Mode,
    /// The policy to begin with: a policy file, or a folder of LeRobot's. Its tokenizer, the folder's tokenizer.json, goes into
    /// the network's policy file: all nodes read instructions with it.
    #[arg(long, value_name = "PATH")]
    policy: Option<PathBuf>,
    /// Begin with random weights: micro, tiny or full (the published dimensions). Instructions become hashed words.
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name, default_value = "micro", conflicts_with = "policy")]
    profile: Profile,
    /// Seed of the profile's random weights.
    #[arg(long, default_value_t = 0, conflicts_with = "policy")]
    seed: u64,
    /// Recordings (LeRobotDataset folders, or hub:owner/name[@revision]) that the ranges of the fixed-point evaluation are chosen from, with eightfold
    /// headroom. Without any, ranges are the default ones.
    #[arg(long = "calibrate", value_name = "DATASET")]
    calibrate: Vec<RecordingName>,
    /// The network's rules, all of them, from a JSON file (`zk0 aggregator rules` prints one to begin with) instead of the
    /// options below.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["min_dataset_samples", "eval_samples", "min_improvement_bps", "max_weight_samples", "hide_losses", "commit_minutes", "submit_minutes", "governors"])]
    rules: Option<PathBuf>,
    #[command(flatten)]
    common: CommonRules,
}

/// Memory for the samples that ranges are chosen from, in bytes.
const CALIBRATION_BYTES: usize = 2 << 30;

/// Guest cycles of a multiply-add in mode `direct`, at best.
const DIRECT_CYCLES: u64 = 4;

/// From so many weights on mode `direct` takes more than twice the cycles of `checked` (docs/prove.md, "How long does it take?").
const DEAR_WEIGHTS: usize = 30_000;

/// A claim whose multiply-adds alone take so many cycles is not proven in mode `direct`: more than a day on two cores, where
/// `checked` takes a small part of that.
const ENDLESS_CYCLES: u64 = 1_000_000_000;

/// Founds the network.
pub fn found(options: &Init) -> Result<()> {
    let key = keys::read(&options.key)?;
    if folder::checkpoint(&options.dir).exists() {
        return Err(LedgerError::AlreadyExists(options.dir.clone()).into());
    }
    let source = options.source();
    let file = source.load()?;
    let PolicyFile { policy, .. } = &file;
    let initial = policy.expert.to_safetensors()?;
    let rules = options.rules(initial.len() as u64)?;
    check_mode(options.mode, policy, &rules)?;
    let spec = options.evaluation(&file)?;
    let quantised = quantise_weights(&spec, &policy.expert)
        .context("the policy's weights in fixed point")?
        .digest(options.mode);
    // Blobs first: there is never a ledger that names weights which are not there.
    let blobs = Blobs::at(&options.dir);
    let policy_file = put_policy(&blobs, &file)?;
    let genesis = Genesis {
        name: options.name.clone(),
        log_key: key.verifying_key().to_bytes(),
        nonce: keys::random()?,
        rules,
        program: verifying_key(options.mode).to_vec(),
        mode: options.mode,
        evaluation: spec.encode(),
        policy: policy_file,
        initial: WeightsDigest {
            blob: blobs.put(&initial)?,
            quantised,
        },
    };
    let (mut ledger, _) = Ledger::create(&options.dir, genesis, key, SystemClock.now_ms())?;
    tracing::info!(
        "founded network {} ({}) on {}{}",
        ledger.state().network(),
        options.name,
        source.name(),
        match file.tokenizer.definition() {
            Some(_) => ", with its own tokenizer",
            None => ", hashing words",
        }
    );
    enrol(&mut ledger, &options.nodes)
}

impl Init {
    fn source(&self) -> PolicySource {
        match &self.policy {
            Some(path) => PolicySource::Path(path.clone()),
            None => PolicySource::Random(self.profile, self.seed),
        }
    }

    /// The rules, under which updates of `expert_bytes` are possible: every one is as long as the initial expert.
    fn rules(&self, expert_bytes: u64) -> Result<Rules> {
        let Some(path) = &self.rules else {
            return self
                .common
                .rules(expert_bytes.next_multiple_of(LEAST_UPDATE_LIMIT));
        };
        let rules = read_rules(path)?;
        if rules.max_update_bytes < expert_bytes {
            bail!(
                "rule max_update_bytes in {} is {}, too little for this policy: an update of it has {expert_bytes} bytes; write \
                 {expert_bytes} there, or more",
                path.display(),
                rules.max_update_bytes
            );
        }
        Ok(rules)
    }

    /// The evaluation, with the default ranges or with those that recordings ask for.
    fn evaluation(&self, file: &PolicyFile) -> Result<EvalSpec> {
        let dims = dims(&file.policy.config)?;
        if self.calibrate.is_empty() {
            return Ok(EvalSpec::new(dims));
        }
        let values = 2 * dims.layers as usize * dims.kv_width() * dims.max_prefix as usize;
        let frames = CALIBRATION_BYTES / (4 * values) / self.calibrate.len();
        let samples = samples(file, &self.calibrate, frames)?;
        calibrated(&file.policy.config, &file.policy.expert, &samples)
    }
}

/// Says where mode `direct` costs more than it has to, and refuses it where no claim could ever be proven.
fn check_mode(mode: Mode, policy: &Policy, rules: &Rules) -> Result<()> {
    if mode != Mode::Direct {
        return Ok(());
    }
    let weights: usize = policy.expert.tensors().values().map(|t| t.data.len()).sum();
    // Both models, each sample, each token of the chunk: every weight once.
    let cycles = [
        2,
        u64::from(rules.eval_samples),
        policy.config.chunk_size as u64,
        weights as u64,
    ]
    .into_iter()
    .fold(DIRECT_CYCLES, u64::saturating_mul);
    let said = format!(
        "in mode direct the guest multiplies by every weight: with {weights} of them and {} samples a claim takes more than {} \
         million cycles",
        rules.eval_samples,
        cycles / 1_000_000
    );
    if cycles >= ENDLESS_CYCLES {
        bail!("{said}, more than a day of proving on two cores; add --mode checked");
    }
    if weights >= DEAR_WEIGHTS {
        tracing::warn!("{said}; --mode checked takes less than half of them");
    }
    Ok(())
}

/// Stores the policy file as it is written: at the published size it is not to be in memory besides the policy.
fn put_policy(blobs: &Blobs, file: &PolicyFile) -> Result<Digest> {
    let failed = || {
        let gib = MAX_POLICY_BYTES >> 30;
        format!("storing the policy file, of {gib} GiB at most: nodes download no larger one")
    };
    let mut blob = Blob(blobs.writer(MAX_POLICY_BYTES)?);
    let written = file.write(BufWriter::with_capacity(1 << 20, &mut blob));
    let digest = Digest(written.with_context(failed)?.digest);
    blob.0.finish(&digest)?;
    Ok(digest)
}

/// A blob as something to write to.
struct Blob(BlobWriter);

impl Write for Blob {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        init: Init,
    }

    #[test]
    fn updates_have_room_in_whole_mebibytes() {
        let line = Line::parse_from(["init", "ledger", "--name", "n", "--key", "k"]);
        let limit = |bytes| line.init.rules(bytes).unwrap().max_update_bytes;
        assert_eq!(limit(1), 1 << 20);
        assert_eq!(limit(1 << 20), 1 << 20);
        assert_eq!(limit((1 << 20) + 1), 2 << 20);
        assert_eq!(limit(393_000_000), 375 << 20);
    }
}
