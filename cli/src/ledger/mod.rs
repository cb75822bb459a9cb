//! `zk0 ledger`: publish, mirror, back up, prune and check a ledger as files.

mod kept_blobs;
mod now;
#[cfg(feature = "full")]
mod prune;
#[cfg(feature = "full")]
mod serve;
mod trust_options;

pub use trust_options::TrustOptions;

#[cfg(feature = "full")]
use crate::blob_store::BlobStoreOptions;
use crate::output::println;
use anyhow::{bail, Result};
use kept_blobs::KeptBlobsOptions;
use now::now_ms;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use zk0_audit::fsck::{fsck, is_export};
use zk0_audit::known_checkpoint::known_checkpoint;
use zk0_audit::log_source::{genesis_at, present_key_at, source};
use zk0_circuits::Digest;
use zk0_ledger::backup::{self, OldBlobs};
use zk0_ledger::blobs::damaged::{DamagedBlob, Removed};
use zk0_ledger::folder::{self, LastBackup};
use zk0_ledger::published::export::export;
use zk0_ledger::published::mirror::{mirror, Mirrored};
use zk0_ledger::published::publication::{Publication, PublicationError};
use zk0_ledger::replay::missing_files::missing_files;
use zk0_ledger::replay::Severity;
use zk0_ledger::{Blobs, LedgerError};
use zk0_protocol::counted::counted;

/// All is done, but files are missing that the open round needs to close.
const FILES_MISSING: u8 = 5;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum LedgerCommand {
    /// Print the verifier key of a ledger's log. With it, anyone can check the log's checkpoints and proofs.
    Vkey {
        /// A ledger's folder, an export of one, or the address of a served log.
        from: String,
        /// Where the log is read over HTTPS, accept only certificates that an authority in this PEM file has signed.
        #[arg(long, value_name = "FILE")]
        ca: Option<PathBuf>,
        /// Print the key that signs the newest published checkpoint, for software that does not follow the log from its founding key to a later one.
        /// All entries are read, because only they show that it is not a former key.
        #[arg(long)]
        present: bool,
    },
    /// Write a ledger as plain files that any web server can serve (C2SP tlog-tiles). An earlier export is brought up to date.
    Export {
        /// The ledger's folder. Its aggregator may be running.
        dir: PathBuf,
        /// Write the files into this folder.
        out: PathBuf,
        #[cfg(feature = "full")]
        #[command(flatten)]
        store: BlobStoreOptions,
    },
    /// Make a ledger's folder from an export or a served log (a mirror). An earlier mirror is brought up to date. Everything is checked
    /// on the way, and the log must continue what was mirrored before. The exit code is 5 if the copy lacks an update or a proof that the open
    /// round has accepted: a log serves these when the round has closed.
    Import(Import),
    /// Make a backup of a ledger's folder. An earlier backup is brought up to date. A backup is a ledger's folder, too. It contains the
    /// private files of the open round, but no keys. What is copied is checked on the way. If a blob of the ledger is damaged, everything
    /// else is copied, and the exit code is 1. Otherwise the ledger's folder records when the backup was made, for `zk0 status`.
    Backup {
        /// The ledger's folder. Its aggregator may be running.
        dir: PathBuf,
        /// The folder of the backup.
        out: PathBuf,
        /// Also check the blobs that the backup has already, and copy damaged ones again. This reads the whole backup.
        #[arg(long)]
        check: bool,
        #[command(flatten)]
        kept: KeptBlobsOptions,
    },
    /// Make a ledger's folder from a backup. If an aggregator goes on from a backup that is too old, it signs a second history of its
    /// log, and auditors will notice. So name the newest checkpoint that anybody has; the backup must contain all that it covers. The exit
    /// code is 5 if an update or a proof is missing that the open round has accepted.
    Restore(Restore),
    /// Delete blobs that audits of the chosen depth do not need, and free their disk. States before what is deleted and what nobody can audit
    /// afterwards. Kept is whatever the open round, the next one, an open vote or a dispute needs.
    #[cfg(feature = "full")]
    Prune(prune::Prune),
    /// Serve a ledger's files over HTTP, for reading (C2SP tlog-tiles).
    #[cfg(feature = "full")]
    Serve(serve::LedgerServeOptions),
    /// Check that a ledger's folder is not damaged: its entries, tree and checkpoints, and all files of weights and proofs that are there.
    /// This checks no proofs; `zk0 audit replay` does. The exit code is 0 if the folder is whole, 1 if it is not, and 5 if it is whole and an
    /// update or a proof is missing that the open round has accepted.
    Fsck {
        /// The ledger's folder. A mirror or a backup is one, too. An export is not a ledger's folder.
        dir: PathBuf,
        #[command(flatten)]
        kept: KeptBlobsOptions,
    },
}

/// `zk0 ledger import`.
#[derive(Debug, clap::Args)]
pub struct Import {
    /// A ledger's folder, an export of one, or the address of a served log.
    from: String,
    /// The ledger's folder to make or to bring up to date.
    dir: PathBuf,
    /// Also read all files of weights and proofs in the folder, and fetch damaged ones again.
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    trust: TrustOptions,
    #[command(flatten)]
    kept: KeptBlobsOptions,
}

/// `zk0 ledger restore`.
#[derive(Debug, clap::Args)]
pub struct Restore {
    /// The folder of the backup.
    backup: PathBuf,
    /// The ledger's folder to make. It must not exist, or be empty, except with --in-place.
    dir: PathBuf,
    /// The ledger's folder is there: copy only the weights and proofs that it lacks, and change nothing else. Its aggregator may be running.
    /// Copied is also what was pruned.
    #[arg(long)]
    in_place: bool,
    /// A checkpoint of the log that somebody has: a file; a folder with a file `checkpoint`, such as an export or a mirror; the address
    /// of a served log; or the address of a witness's last checkpoint. Repeat the option for more checkpoints.
    #[arg(
        long,
        value_name = "FILE|DIR|ADDRESS",
        required_unless_present_any = ["no_newer_checkpoint_exists", "in_place"]
    )]
    checkpoint: Vec<String>,
    /// Where a checkpoint is read over HTTPS, accept only certificates that an authority in this PEM file has signed.
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Go on without a checkpoint. Use this only if you know that the log signed nothing after the backup was made.
    #[arg(long)]
    no_newer_checkpoint_exists: bool,
    /// Accept only the ledger of the network with this id.
    #[arg(long, value_name = "ID")]
    network: Option<Digest>,
    #[command(flatten)]
    kept: KeptBlobsOptions,
}

/// Runs the command.
pub fn run(command: &LedgerCommand) -> Result<ExitCode> {
    match command {
        LedgerCommand::Vkey { from, ca, present } => {
            let key = if *present {
                present_key_at(from, ca.as_deref())?
            } else {
                genesis_at(from, ca.as_deref())?.verifier_key()?
            };
            println!("{key}");
        }
        LedgerCommand::Export {
            dir,
            out,
            #[cfg(feature = "full")]
            store,
        } => {
            let view = Publication::open(dir, None)?;
            #[cfg(feature = "full")]
            let view = view.with_blobs(store.blobs(dir)?);
            let done = export(&view, out)?;
            println!(
                "{} published; wrote {} and {} to {}",
                counted(done.entries, "entry", "entries"),
                counted(done.tiles, "tile", "tiles"),
                counted(done.blobs, "blob", "blobs"),
                out.display()
            );
            let missing = "missing: this ledger does not keep";
            match done.missing_blobs {
                0 => {}
                1 => println!("1 public blob is {missing} it"),
                count => println!("{count} public blobs are {missing} them"),
            }
            name_damaged(&done.damaged)?;
        }
        LedgerCommand::Import(options) => {
            import(options)?;
            return name_missing(&options.dir, &options.kept);
        }
        LedgerCommand::Backup {
            dir,
            out,
            check,
            kept,
        } => {
            let blobs = kept.blobs(dir)?;
            let old = if *check { OldBlobs::Checked } else { OldBlobs::Trusted };
            let done = backup::backup_with(dir, &blobs, out, old)?;
            copied(&done);
            match done.mended_blobs {
                0 => {}
                count => println!(
                    "{} damaged in the backup, and copied again",
                    counted(count, "blob was", "blobs were")
                ),
            }
            println!("backed up to {}", out.display());
            name_damaged(&done.damaged)?;
            let last = LastBackup {
                time_ms: now_ms()?,
                entries: done.entries,
            };
            if let Err(error) = folder::write_backed_up(dir, last) {
                tracing::warn!("the backup is made, but `zk0 status` does not show it: {error}");
            }
        }
        LedgerCommand::Restore(options) => {
            restore(options)?;
            return name_missing(&options.dir, &options.kept);
        }
        #[cfg(feature = "full")]
        LedgerCommand::Prune(options) => prune::prune(options)?,
        #[cfg(feature = "full")]
        LedgerCommand::Serve(options) => serve::serve(options)?,
        LedgerCommand::Fsck { dir, .. } if is_export(dir) => bail!(
            "{0} is an export: `zk0 ledger import {0} FOLDER` makes a ledger's folder of it, which can be checked",
            dir.display()
        ),
        LedgerCommand::Fsck { dir, .. } if !folder::database(dir).exists() => {
            return Err(LedgerError::NoLedger(dir.clone()).into())
        }
        LedgerCommand::Fsck { dir, kept } => {
            return if check(dir) {
                name_missing(dir, kept)
            } else {
                Ok(ExitCode::FAILURE)
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn restore(options: &Restore) -> Result<()> {
    let (backup, dir, network) = (&options.backup, &options.dir, options.network.as_ref());
    if options.in_place {
        let done = backup::restore_blobs(backup, dir, network)?;
        copied(&done);
        return name_damaged(&done.damaged);
    }
    let known = options
        .checkpoint
        .iter()
        .map(|from| known_checkpoint(from, options.ca.as_deref()))
        .collect::<Result<Vec<_>>>()?;
    let done = backup::restore(backup, dir, network, &known)?;
    copied(&done);
    println!("restored to {}", dir.display());
    if known.is_empty() {
        println!(
            "WARNING      if the log has signed a checkpoint of more than {}, do not start its aggregator: it would \
             sign a second history",
            counted(done.entries, "entry", "entries")
        );
    }
    Ok(())
}

fn import(options: &Import) -> Result<()> {
    let trust = options.trust.read()?;
    let source = source(&options.from, trust.ca.as_deref())?;
    let import = || {
        mirror(
            source.as_ref(),
            &options.dir,
            trust.witness_policy.as_ref(),
            trust.network.as_ref(),
        )
    };
    copied(&import()?);
    if options.check {
        let blobs = Blobs::at(&options.dir);
        let Removed {
            removed,
            unreadable,
        } = blobs.remove_all_damaged()?;
        if !removed.is_empty() {
            import()?;
        }
        let lost: Vec<_> = removed
            .iter()
            .filter(|blob| !blobs.contains(blob))
            .collect();
        println!(
            "{} damaged; {} fetched again",
            counted(
                (removed.len() + unreadable.len()) as u64,
                "blob was",
                "blobs were"
            ),
            removed.len() - lost.len()
        );
        for blob in &lost {
            tracing::error!(
                "blob {blob} was damaged and is removed, and {} does not have it",
                options.from
            );
        }
        for blob in &unreadable {
            tracing::error!("{blob}");
        }
        match lost.len() + unreadable.len() {
            0 => {}
            1 => bail!("1 blob of the copy is not whole; it is named above"),
            count => bail!("{count} blobs of the copy are not whole; they are named above"),
        }
    }
    Ok(())
}

fn name_damaged(damaged: &[DamagedBlob]) -> Result<()> {
    for blob in damaged {
        tracing::error!("a blob was not copied: {blob}");
    }
    match damaged.len() {
        0 => Ok(()),
        1 => bail!("everything was copied but 1 damaged blob, which is named above"),
        count => bail!("everything was copied but {count} damaged blobs, which are named above"),
    }
}

fn copied(done: &Mirrored) {
    println!("network {}", done.network);
    println!(
        "{}, {} of them new; {} new",
        counted(done.entries, "entry", "entries"),
        done.new_entries,
        counted(done.new_blobs, "blob", "blobs")
    );
    match done.missing_blobs {
        0 => {}
        1 => println!("1 blob is missing: it is not public yet, or is no longer kept"),
        count => {
            println!("{count} blobs are missing: they are not public yet, or are no longer kept")
        }
    }
}

/// Names missing files that the open round needs to close.
fn name_missing(dir: &Path, kept: &KeptBlobsOptions) -> Result<ExitCode> {
    let missing = missing_files(dir, &kept.blobs(dir)?)?;
    let Some(first) = missing.first() else {
        return Ok(ExitCode::SUCCESS);
    };
    for file in &missing {
        println!("MISSING      {file}");
    }
    println!(
        "             round {} cannot close with this folder until they are back: take them from another copy with \
         `zk0 ledger restore COPY {} --in-place`. A mirror gets them when the round has closed",
        first.round,
        dir.display()
    );
    Ok(ExitCode::from(FILES_MISSING))
}

fn check(dir: &Path) -> bool {
    let found = fsck(dir);
    match &found.published {
        Ok(entries) => println!("published    {}", counted(*entries, "entry", "entries")),
        Err(error @ PublicationError::NotCosigned(_)) => println!("note         {error}"),
        Err(error) => println!("FAULT        {error}"),
    }
    println!("entries      {}", found.report.entries);
    for finding in &found.report.findings {
        let severity = match finding.severity {
            Severity::Note => "note",
            Severity::NotChecked => "NOT CHECKED",
            Severity::Fault => "FAULT",
        };
        println!("{severity:<12} {}", finding.text);
    }
    println!(
        "{}",
        if found.is_whole() {
            "WHOLE        proofs were not checked; `zk0 audit replay` checks them"
        } else {
            "DAMAGED      the lines above state what is damaged"
        }
    );
    found.is_whole()
}
