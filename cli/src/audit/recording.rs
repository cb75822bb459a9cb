//! `zk0 audit recording`: compares a registered dataset with its recording, given the node's secret.

use super::failed::AuditFailed;
use crate::dataset::{CameraNames, RecordingName};
use crate::ledger::TrustOptions;
use crate::output::println;
use crate::policy::{cache_failed, CacheOptions};
use anyhow::{Context, Error, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use zk0_audit::fetch::{locate, WantedBlobs};
use zk0_audit::log_source::WrongUsage;
use zk0_audit::report::history;
use zk0_audit::run::{mend, unjudged};
use zk0_circuits::claim::dataset::check_leaves;
use zk0_circuits::{Digest, EvalSpec};
use zk0_files::bounded_file;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::replay::{self, replay_with, Severity};
use zk0_lerobot::dataset::Dataset;
use zk0_node::error::ParticipantError;
use zk0_node::recording::recompute::{recompute, Recomputed};
use zk0_node::recording::secret::{Secrets, MAX_BYTES};
use zk0_node::recording::OpenRecording;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::evaluation_set::{distinct, DRAWN_LEAF_BYTES};

/// `zk0 audit recording`.
#[derive(Debug, clap::Args)]
pub struct AuditRecordingOptions {
    /// The ledger's folder or a copy of it, an export, or the address of a served log.
    ledger: String,
    /// The number of the entry that registered the dataset. `zk0 audit show LEDGER --node NAME` lists a node's entries.
    #[arg(long, value_name = "INDEX")]
    entry: u64,
    /// The recording: a LeRobotDataset folder, or hub:owner/name[@revision] on the Hugging Face Hub.
    #[arg(long, value_name = "RECORDING")]
    recording: RecordingName,
    #[command(flatten)]
    cameras: CameraNames,
    /// The node's secret: the file `secret` of its state folder. Show it to nobody: whoever has it can check guesses of the
    /// samples of the dataset.
    #[arg(long, value_name = "FILE")]
    secret: PathBuf,
    /// Keep what is fetched from an address or an export in this folder.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Runs the command. Returns `false` if the registered samples differ from the recording's.
pub fn run(options: &AuditRecordingOptions) -> Result<bool> {
    let trust = options.trust.read()?;
    // Wrong files are named before hours of reading.
    let secrets = secrets(&options.secret)?;
    let mirror = options.mirror.as_deref();
    let located = locate(&options.ledger, mirror, &trust, WantedBlobs::Everything)?;
    let dir = &located.dir;
    let replaying = replay::ReplayOptions {
        opened: replay::open(dir)?,
        network: trust.network,
        ..replay::ReplayOptions::default()
    };
    let report = replay_with(dir, replaying, &mut ());
    let mut faults = report.findings.iter();
    if let Some(fault) = faults.find(|finding| finding.severity == Severity::Fault) {
        let why = format!("the ledger is not right: {}", fault.text);
        return Err(Error::msg(AuditFailed(why)));
    }
    if let Some(unread) = &report.unread {
        return Err(unjudged(unread));
    }
    let root = report.root.clone().unwrap_or_default();
    let (genesis, registration) = registered(dir, report.entries, &root, options.entry)?;
    let blobs = Blobs::at(dir);
    if let Some(fetch_again) = &located.fetch_again {
        let needed = [registration.leaves, genesis.policy];
        let damaged =
            |blob: &Digest| matches!(blobs.check(blob), Err(BlobError::WrongDigest { .. }));
        let damaged: BTreeSet<_> = needed.into_iter().filter(damaged).collect();
        if !damaged.is_empty() {
            mend(&blobs, &damaged, fetch_again)?;
        }
    }
    let most = registration.drawn() * DRAWN_LEAF_BYTES as u64;
    let list = whole(
        blobs.get(&registration.leaves, most),
        "reading the list of drawn frames",
    )?;
    let not_right = || AuditFailed("the registered list of drawn frames is not right".into());
    let list = registration.read_list(&list).with_context(not_right)?;
    check_leaves(&registration.dataset, &distinct(&list)).with_context(not_right)?;
    whole(
        blobs.check(&genesis.policy),
        "checking the network's policy",
    )?;
    let cache = options.cache.open()?;
    let spec = EvalSpec::decode(&genesis.evaluation)?;
    let policy = blobs.path(&genesis.policy);
    let recording = options.recording.locate()?;
    if !recording.is_dir() {
        let recording = recording.display();
        return Err(WrongUsage(format!("--recording {recording}: there is no such folder")).into());
    }
    let found = (|| {
        let dataset = Dataset::open(&recording)?.renamed(&options.cameras.rename_map)?;
        let recording = OpenRecording::of(dataset, &policy, cache.as_ref())?;
        let maker = recording.maker();
        let samples = recording.samples(&maker);
        recompute(
            &recording,
            &samples,
            (genesis.mode, &spec),
            &registration,
            &list,
            &secrets,
        )
    })();
    let found = found.map_err(|error| match error {
        ParticipantError::Cache(error) => cache_failed(error),
        error => error.into(),
    })?;
    println!("{}", verdict(&found, options, &registration));
    Ok(matches!(found, Recomputed::Same { .. }))
}

fn registered(
    dir: &Path,
    entries: u64,
    root: &str,
    index: u64,
) -> Result<(Genesis, DatasetRegistration)> {
    let (mut genesis, mut wanted) = (None, None);
    history::read(dir, entries, root, |at, entry| match &entry.body {
        Body::Genesis(found) => genesis = Some(found.clone()),
        Body::DatasetCommitted(signed) if at == index => wanted = Some(signed.statement.clone()),
        _ => {}
    })?;
    let genesis = genesis.context("the ledger has no genesis")?;
    match wanted {
        Some(registration) => Ok((genesis, registration)),
        None if index >= entries => Err(WrongUsage(format!(
            "--entry {index}: there is no entry {index}: the ledger has {entries}"
        ))
        .into()),
        None => Err(WrongUsage(format!(
            "--entry {index}: entry {index} does not register a dataset: `zk0 audit show LEDGER --entries` states what it is"
        ))
        .into()),
    }
}

/// A missing blob shows nothing about the ledger, but one with other bytes is a fault.
fn whole<T>(read: Result<T, BlobError>, what: &'static str) -> Result<T> {
    let wrong = matches!(
        read,
        Err(BlobError::WrongDigest { .. } | BlobError::TooLarge { .. })
    );
    let read = read.context(what);
    if wrong {
        read.with_context(|| AuditFailed("a file of the ledger is not what its name states".into()))
    } else {
        read
    }
}

fn secrets(path: &Path) -> Result<Secrets, WrongUsage> {
    let shown = path.display();
    let bytes = bounded_file::read(path, MAX_BYTES)
        .map_err(|error| WrongUsage(format!("--secret {shown}: {error}")))?;
    Secrets::decode(&bytes).map_err(|why| {
        WrongUsage(format!(
            "--secret {shown} is not the file `secret` of a node's state folder: {why}"
        ))
    })
}

fn verdict(
    found: &Recomputed,
    options: &AuditRecordingOptions,
    registration: &DatasetRegistration,
) -> String {
    let (entry, node, recording) = (options.entry, registration.node, &options.recording);
    let failed = |why: String| {
        format!("FAILED      the dataset of node {node} (entry {entry}) is not that of {recording}: {why}")
    };
    match found {
        Recomputed::Same { frames } => format!(
            "VERIFIED    all {frames} drawn frames of {recording} give the samples that node {node} registered (entry {entry})"
        ),
        Recomputed::OtherSecret => failed(format!(
            "the node did not commit with a secret in {}",
            options.secret.display()
        )),
        Recomputed::OtherFeatures { found } => failed(format!(
            "the registration states that its features have the digest {}, but they have {found}",
            registration.dataset.feature_spec
        )),
        Recomputed::OtherEpisodes { missing, extra } => failed(format!(
            "{} registered episodes are not in the recording with this number of frames{}, and {} of its episodes are not registered{}",
            missing.len(),
            first(missing),
            extra.len(),
            first(extra),
        )),
        Recomputed::OtherSamples { frames, differ, of } => {
            let frames: Vec<_> = frames.iter().map(u64::to_string).collect();
            failed(format!(
                "{differ} of {of} drawn frames give other samples, among them {}; if the node computed them on another kind of CPU, \
                 repeat the audit on that kind, because samples are compared bit for bit",
                frames.join(", ")
            ))
        }
    }
}

fn first<T: ToString>(digests: &[T]) -> String {
    let first = digests.first().map(T::to_string);
    first.map_or_else(String::new, |digest| format!(" (the first is {digest})"))
}
