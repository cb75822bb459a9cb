//! `zk0 aggregator init`: founds a network on a policy.

use super::public_samples::PublicSampleOptions;
use super::rotate_log_key::give;
use super::rules::{read_rules, CommonRules, LEAST_UPDATE_LIMIT};
use super::NodeToEnrol;
use crate::dataset::RecordingName;
use crate::keys;
use crate::policy::calibration::{calibrated, samples};
use crate::policy::PolicySource;
use anyhow::{bail, Context, Result};
use ed25519_dalek::SigningKey;
use std::io::Write;
use std::path::PathBuf;
use zk0_aggregator::round::founding::{check_free, check_nodes, enrol, Founding};
use zk0_aggregator::{Clock, SystemClock};
use zk0_argument::claim::most_samples;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::spec::{Dims, EvalSpec};
use zk0_circuits::{Digest, Mode, WeightsDigest};
use zk0_ledger::blobs::Blobs;
use zk0_node::participant::MAX_POLICY_BYTES;
use zk0_node::recording::agreement;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::{Genesis, Rules};
use zk0_prover::measure::{DirectCost, DirectMode};
use zk0_smolvla::measure::fixed_point::{dims, quantise_weights};
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::{Policy, Profile};
use zk0_weights::Format;

/// `zk0 aggregator init`.
#[derive(Debug, clap::Args)]
pub struct Init {
    /// Make the ledger in this folder, which must not hold one yet.
    dir: PathBuf,
    /// The network's name. It is also the origin of the log's checkpoints, so an address such as log.example/arms is best.
    #[arg(long)]
    name: String,
    /// The file of the log's signing key, made by `zk0 aggregator keygen`.
    #[arg(long)]
    key: PathBuf,
    /// Found the network with the operator's key in this file, and give the log the key of --key. The file is made if it does not exist. Keep it
    /// away from the aggregator: it gives the log another key when that is stolen or lost, and suspends nodes [default: --key is both]
    #[arg(long, value_name = "FILE")]
    operator_key: Option<PathBuf>,
    /// Enrol this node. `zk0 node keygen` prints its identity; the name is for people. Repeat the option for more nodes.
    #[arg(long = "node", value_name = "NAME=IDENTITY")]
    nodes: Vec<NodeToEnrol>,
    /// How the evaluation is proven. direct: the proven program evaluates, which costs least for small policies; nodes send the samples of each
    /// claim to their proving service. succinct: it verifies an argument that the node makes before, which shows the proving service no sample,
    /// and costs less for all larger policies, up to the published size. Without this option, zk0 takes the mode that costs fewer cycles, and
    /// states which.
    #[arg(long)]
    mode: Option<Mode>,
    /// Begin with this policy: a policy file, or a LeRobot policy folder. The folder's tokenizer.json, or that of the repository which it names,
    /// goes into the network's policy file, and all nodes read instructions with it.
    #[arg(long, value_name = "PATH")]
    policy: Option<PathBuf>,
    /// Begin with random weights of this size: micro, tiny or full (the published dimensions). Such a policy reads instructions as
    /// hashed words.
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name, default_value = "micro", conflicts_with = "policy")]
    profile: Profile,
    /// The seed of the random weights.
    #[arg(long, default_value_t = 0, conflicts_with = "policy")]
    seed: u64,
    /// Choose the ranges of the fixed-point numbers from this recording, with eightfold headroom (a LeRobotDataset folder, or
    /// hub:owner/name[@revision]). Repeat the option for more recordings. Without it, the default ranges are used.
    #[arg(long = "calibrate", value_name = "RECORDING")]
    calibrate: Vec<RecordingName>,
    /// Take all the network's rules from this JSON file, instead of the options below. `zk0 aggregator rules` prints a file to begin
    /// with.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["min_dataset_samples", "evaluation_frames", "min_eval_samples", "max_eval_samples", "min_improvement_bps", "confidence", "hide_losses", "commit_minutes", "submit_minutes", "randomness", "governors", "recordings_like"])]
    rules: Option<PathBuf>,
    #[command(flatten)]
    common: CommonRules,
    /// Found a network whose rules nobody can ever change: no vote revokes a node, replaces a key that is lost or stolen, names another guest
    /// program or goes back to earlier weights. Without this option, the rules have to name governors.
    #[arg(long)]
    rules_never_change: bool,
    #[command(flatten)]
    public: PublicSampleOptions,
}

/// In bytes, for calibration samples.
const CALIBRATION_BYTES: usize = 2 << 30;

fn weights(policy: &Policy) -> usize {
    policy.expert.tensors().values().map(|t| t.data.len()).sum()
}

fn check_samples(mode: Mode, spec: &EvalSpec, least: u32) -> Result<()> {
    let most = most_samples(mode, spec);
    if least > most {
        bail!(
            "rule min_eval_samples is {least}, and in mode {mode} a claim about a policy of this size has at most {most} samples: \
             set it to at most {most}"
        );
    }
    Ok(())
}

fn check_governors(rules: &Rules, never_change: bool) -> Result<()> {
    let governance = &rules.governance;
    let is_fixed = governance.governors.is_empty() && governance.credits_per_vote == 0;
    match (is_fixed, never_change) {
        (true, false) => bail!(
            "the rules name no governors, so nobody could ever revoke a node, replace a stolen key, or change a rule: add --governor NAME=IDENTITY (`zk0 governance keygen` makes a key and prints its identity), or --rules-never-change if that is what you want"
        ),
        (false, true) => bail!(
            "the rules can be changed by governors or by credits: leave out --rules-never-change, or the governors"
        ),
        _ => Ok(()),
    }
}

/// Founds the network.
pub fn found(options: &Init) -> Result<()> {
    let key = keys::read(&options.key)?;
    // First, because the rest can take minutes.
    check_free(&options.dir)?;
    let source = options.source();
    let file = source.load()?;
    if let Some(folder) = source.lerobot()? {
        if let Err(error) = folder.check_has_statistics() {
            tracing::warn!(
                "{error}. The network does not need them, because each node normalises with the statistics of its own recording; whoever exports or \
                 publishes a policy of this network has to name a recording with --statistics-of"
            );
        }
    }
    let dims = dims(&file.policy.config)?;
    // The ranges do not change the file's size.
    let mut rules = options.rules(Format::new(&EvalSpec::new(dims))?.file_bytes())?;
    check_governors(&rules, options.rules_never_change)?;
    let named = rules.public_samples.as_ref();
    options.public.check(weights(&file.policy), named)?;
    for recording in options.calibrate.iter().chain(options.public.recordings()) {
        let agrees = agreement::check(&rules.recordings, &recording.open()?, &file.policy.config);
        agrees.with_context(|| format!("recording {recording}"))?;
    }
    let mode = options.mode(&file.policy, rules.min_eval_samples)?;
    rules.check_in(mode).map_err(anyhow::Error::msg)?;
    check_samples(mode, &EvalSpec::new(dims), rules.min_eval_samples)?;
    let nodes: Vec<NodeEnrolled> = options.nodes.iter().map(Into::into).collect();
    let operator = options.operator(&key)?;
    let founder = operator.clone().unwrap_or_else(|| key.clone());
    let founding_key = founder.verifying_key().to_bytes();
    let known = options.known(founding_key, rules.clone(), mode, EvalSpec::new(dims));
    // A later refusal would leave a ledger in the way of the corrected command.
    check_nodes(known, &nodes, SystemClock.now_ms())?;
    let evaluation = options.evaluation(&file, dims)?;
    let initial = quantise_weights(&evaluation, &file.policy.expert)
        .context("the policy's weights in fixed point")?;
    let public = options
        .public
        .samples(rules.public_samples, &file, &evaluation)?;
    let (rule, public_samples) = public.unzip();
    rules.public_samples = rule;
    if rules.public_samples.is_none() {
        tracing::warn!(
            "the rules name no public samples, so that nobody evaluates a round's result before it becomes the new global weights: \
             add --public-recording with a recording that no node has"
        );
    }
    if rules.recordings.is_empty() {
        tracing::warn!(
            "the rules ask nothing of recordings, so that nodes may record in other units, with other cameras and at other rates, and nobody notices: \
             add --recordings-like with a recording as all of them should be"
        );
    }
    if operator.is_none() {
        tracing::warn!(
            "the log's key is the operator's, too, and lies beside the aggregator: a thief of it has the network. Add --operator-key with a file to \
             keep elsewhere, or give the log another key later (`zk0 aggregator rotate-log-key`)"
        );
    }
    let founding = Founding {
        name: options.name.clone(),
        nonce: keys::random()?,
        rules,
        program: verifying_key(mode).to_vec(),
        mode,
        initial: Format::new(&evaluation)?.write(&initial),
        quantised: initial.digest(mode),
        evaluation,
        public_samples,
    };
    let write_policy = |out: &mut dyn Write| file.write(out).map(|written| written.digest);
    let mut ledger = founding.found(
        &options.dir,
        founder,
        &SystemClock,
        MAX_POLICY_BYTES,
        write_policy,
    )?;
    tracing::info!(
        "founded network {} ({}) on the policy {}, {}",
        ledger.state().network(),
        options.name,
        source.name(),
        match file.tokenizer.definition() {
            Some(_) => "with its own tokenizer",
            None => "which reads instructions as hashed words",
        }
    );
    if let (Some(operator), Some(file)) = (operator, &options.operator_key) {
        drop(ledger);
        (ledger, _) = give(&options.dir, &operator, key, Blobs::at(&options.dir))?;
        tracing::info!(
            "the operator's key in {} founded the network, and gave the log its key. Move the file to where the aggregator does not run: nobody else \
             can give the log another key",
            file.display()
        );
    }
    Ok(enrol(&mut ledger, nodes, &SystemClock)?)
}

impl Init {
    /// The operator's own key, if it has one.
    fn operator(&self, key: &SigningKey) -> Result<Option<SigningKey>> {
        let Some(file) = &self.operator_key else {
            return Ok(None);
        };
        if file.exists() {
            tracing::warn!(
                "the operator's key in {} exists already. One key is for one network: if it has founded another one, name another file",
                file.display()
            );
        }
        let operator = keys::read_or_generate(file)?;
        if operator == *key {
            bail!("--operator-key and --key name the same key: make another one with `zk0 aggregator keygen`, or leave --operator-key out");
        }
        Ok(Some(operator))
    }

    fn source(&self) -> PolicySource {
        match &self.policy {
            Some(path) => PolicySource::Path(path.clone()),
            None => PolicySource::Random(self.profile, self.seed),
        }
    }

    /// The genesis before ranges and policy are known.
    fn known(&self, log_key: [u8; 32], rules: Rules, mode: Mode, evaluation: EvalSpec) -> Genesis {
        let unknown = Digest([0; 32]);
        Genesis {
            name: self.name.clone(),
            log_key,
            nonce: unknown.0,
            rules,
            program: verifying_key(mode).to_vec(),
            mode,
            evaluation: evaluation.encode(),
            policy: unknown,
            initial: WeightsDigest {
                blob: unknown,
                quantised: unknown,
            },
        }
    }

    /// Refuses `direct` where the proof of a claim would take more than a day.
    fn mode(&self, policy: &Policy, samples: u32) -> Result<Mode> {
        let weights = weights(policy);
        let direct = DirectMode {
            weights: weights as u64,
            samples,
            chunk: policy.config.chunk_size as u64,
        };
        let best = direct.best();
        let reported = format!(
            "in mode direct the guest multiplies by every weight: with {weights} weights and {samples} samples a claim takes more than {} \
             million cycles",
            direct.cycles() / 1_000_000
        );
        match (self.mode, direct.cost()) {
            (None, _) => tracing::info!(
                "claims are proven in mode {best}, which takes fewer cycles than the other for a policy of {weights} expert weights{}",
                match best {
                    Mode::Direct => "; nodes send the samples of each claim to their proving service, which --mode succinct avoids",
                    Mode::Succinct => "",
                }
            ),
            (Some(Mode::Direct), DirectCost::Endless) => {
                bail!("{reported}, which is more than a day of proving on two cores; add --mode succinct")
            }
            (Some(Mode::Direct), DirectCost::Dear) => {
                tracing::warn!("{reported}; --mode succinct takes fewer")
            }
            _ => {}
        }
        Ok(self.mode.unwrap_or(best))
    }

    /// Rules that allow updates of `update_bytes`, the size of the initial weights.
    fn rules(&self, update_bytes: u64) -> Result<Rules> {
        let Some(path) = &self.rules else {
            return self
                .common
                .rules(update_bytes.next_multiple_of(LEAST_UPDATE_LIMIT));
        };
        let rules = read_rules(path)?;
        if rules.max_update_bytes < update_bytes {
            bail!(
                "rule max_update_bytes in {} is {}, too little for this policy: an update of it has {update_bytes} bytes; write \
                 {update_bytes} there, or more",
                path.display(),
                rules.max_update_bytes
            );
        }
        Ok(rules)
    }

    fn evaluation(&self, file: &PolicyFile, dims: Dims) -> Result<EvalSpec> {
        if self.calibrate.is_empty() {
            return Ok(EvalSpec::new(dims));
        }
        let values = 2 * dims.layers as usize * dims.kv_width() * dims.max_prefix as usize;
        let frames = CALIBRATION_BYTES / (4 * values) / self.calibrate.len();
        let samples = samples(file, &self.calibrate, frames)?;
        calibrated(&file.policy.config, &file.policy.expert, &samples)
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
        assert_eq!(limit(197_000_000), 188 << 20);
    }
}
