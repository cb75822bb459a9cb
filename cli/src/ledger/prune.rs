//! `zk0 ledger prune`: shows and deletes the blobs in a ledger's folder that no audit of the chosen depth needs.

use crate::blob_store::BlobStoreOptions;
use crate::keys;
use crate::ledger::now::now_ms;
use crate::output::println;
use anyhow::{bail, Result};
use std::path::PathBuf;
use zk0_ledger::prune::{Doomed, Longer, PrunePlan, Reason, Retention, MOST_UNNAMED};
use zk0_ledger::Ledger;
use zk0_protocol::counted::counted;
use zk0_protocol::pruning::rounds_before;

/// `zk0 ledger prune`.
#[derive(Debug, clap::Args)]
pub struct Prune {
    /// The ledger's folder. Its aggregator must not be running, except with --dry-run.
    dir: PathBuf,
    /// The file of the log's signing key. With it you sign which blobs are no longer kept, so that auditors can tell them from lost ones.
    #[arg(long, value_name = "FILE", required_unless_present = "dry_run")]
    key: Option<PathBuf>,
    /// Delete the updates of rounds that are older than the last N closed ones. Without this option, only blobs are deleted that no audit
    /// reads.
    #[arg(long, value_name = "N")]
    keep_rounds: Option<u64>,
    /// Delete the proofs of these older rounds, too. Otherwise a light audit can still check them.
    #[arg(long, requires = "keep_rounds")]
    proofs_too: bool,
    /// Delete the global weights of these older rounds, too. Votes can then not restore them.
    #[arg(long, requires = "keep_rounds")]
    weights_too: bool,
    /// The aggregator's --checkpoint-interval, if it writes policy folders: keep the weights of the folder that was due last.
    #[arg(long, value_name = "N", requires = "weights_too", value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_interval: Option<u64>,
    /// Only state what would be deleted.
    #[arg(long)]
    dry_run: bool,
    /// Delete more than 10 files that no entry names. Perhaps they are another network's.
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    store: BlobStoreOptions,
}

const KINDS: [(Reason, &str, &str); 5] = [
    (Reason::Update, "update", "updates"),
    (Reason::Proof, "proof", "proofs"),
    (
        Reason::Weights,
        "file of global weights",
        "files of global weights",
    ),
    (
        Reason::Unread,
        "update or proof that no audit reads: its claim was refused for another reason, or never came",
        "updates or proofs that no audit reads: their claims were refused for another reason, or never came",
    ),
    (
        Reason::Unnamed,
        "file that no entry names",
        "files that no entry names",
    ),
];

/// Runs the command.
pub fn prune(options: &Prune) -> Result<()> {
    let keep = Retention {
        rounds: options.keep_rounds,
        without_proofs: options.proofs_too,
        without_weights: options.weights_too,
        checkpoint_interval: options.checkpoint_interval,
    };
    let now_ms = now_ms()?;
    let Some(key) = options.key.as_ref().filter(|_| !options.dry_run) else {
        let kept = options.store.blobs_beside_writer(&options.dir)?;
        tell(&PrunePlan::look(&options.dir, &kept, &keep, now_ms)?);
        println!("dry run      nothing was deleted");
        return Ok(());
    };
    let kept = options.store.blobs(&options.dir)?;
    // Meanwhile no aggregator can open the ledger.
    let ledger = Ledger::open_with(&options.dir, None, keys::read(key)?, kept, &mut ())?;
    let plan = PrunePlan::of(&ledger, &keep, now_ms)?;
    tell(&plan);
    let (unnamed, size) = plan.unnamed();
    if unnamed > MOST_UNNAMED && !options.yes {
        bail!(
            "no entry of this ledger names {}, which would be deleted: look where they come from. If they are no other network's, give --yes. Nothing was deleted",
            files(unnamed, size)
        );
    }
    plan.carry_out(&ledger)?;
    println!("deleted      {}", blobs(plan.doomed.len(), plan.bytes()));
    Ok(())
}

fn tell(plan: &PrunePlan) {
    println!("closed       {}", counted(plan.closed, "round", "rounds"));
    match plan.longer {
        Some(Longer::Disputable(round)) => println!(
            "kept longer  rounds from {round} on: a contribution to round {round} may still be disputed"
        ),
        Some(Longer::NotCosigned(round)) => println!(
            "kept longer  rounds from {round} on: the witnesses have not cosigned the end of round {round}"
        ),
        Some(Longer::ControlVariates(round)) => println!(
            "kept longer  rounds from {round} on: nodes compute SCAFFOLD's control variates from their updates"
        ),
        None => {}
    }
    let older = rounds_before(plan.first_kept);
    for (reason, one, many) in KINDS {
        let these = plan.doomed.iter().filter(|blob| blob.reason == reason);
        let sizes: Vec<_> = these.map(|blob: &Doomed| blob.size).collect();
        if sizes.is_empty() {
            continue;
        }
        let count = counted(sizes.len() as u64, one, many);
        let of = match reason {
            Reason::Update | Reason::Proof | Reason::Weights => format!(" of {older}"),
            Reason::Unread | Reason::Unnamed => String::new(),
        };
        println!("delete       {}, {count}{of}", bytes(sizes.iter().sum()));
    }
    if plan.doomed.is_empty() {
        println!("delete       nothing");
    }
    let (kept, size) = plan.kept;
    println!("keep         {}", blobs(kept, size));
    let deletes = |reason| plan.doomed.iter().any(|blob| blob.reason == reason);
    if deletes(Reason::Update) {
        println!(
            "afterwards   nobody can check the updates of {older} from this folder, nor compute again how they were combined; an audit of them \
             is INCOMPLETE"
        );
    }
    if deletes(Reason::Proof) {
        println!("afterwards   nobody can check the proofs of {older} from this folder, not even a light audit");
    }
    if deletes(Reason::Weights) {
        println!("afterwards   no vote can restore the deleted weights of {older}, and nobody can check them from this folder");
    }
    if let Some(statement) = &plan.statement {
        println!("sign         {statement}");
    }
}

fn blobs(count: usize, size: u64) -> String {
    let count = counted(count as u64, "blob", "blobs");
    format!("{count}, {}", bytes(size))
}

fn files(count: usize, size: u64) -> String {
    format!(
        "{}, {}",
        counted(count as u64, "file", "files"),
        bytes(size)
    )
}

fn bytes(size: u64) -> String {
    counted(size, "byte", "bytes")
}
