//! `zk0 ledger`: a ledger as others read it: files and mirrors. Proofs that stand alone are made by [`crate::audit`].

use anyhow::{bail, Context, Result};
use std::{
    fs,
    io::Read,
    path::{Path, PathBuf},
};
use zk0_audit::{
    blob_check::BlobCheck,
    log_source::{genesis, source, Trust},
};
use zk0_circuits::Digest;
use zk0_ledger::{
    backup, folder,
    published::{
        export::export,
        mirror::{mirror, Mirrored},
        publication::Publication,
        source::Source,
        web::Web,
    },
    replay::{replay, Verdict},
};
use zk0_protocol::tlog::{
    checkpoint::MAX_NOTE_BYTES,
    witness_policy::{WitnessPolicy, MAX_POLICY_BYTES},
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Print the verifier key of a ledger's log: what its checkpoints and proofs are checked with.
    Vkey {
        /// A ledger's directory, an export of one, or the address of a served log.
        from: String,
    },
    /// Write a ledger as plain files (C2SP tlog-tiles) that any web server serves; or bring an earlier export up to date.
    Export {
        /// The ledger's directory; its aggregator may be running.
        dir: PathBuf,
        /// Where the files go.
        out: PathBuf,
    },
    /// Make a ledger's directory from an export or a served log, or bring an earlier one up to date. Everything is checked on
    /// the way; what was mirrored before has to be continued.
    Import(Import),
    /// Make a backup of a ledger's directory, or bring an earlier one up to date. Its aggregator may be running. A backup is a
    /// directory like it, with the private blobs of the open round and without keys; everything is checked on the way.
    Backup {
        /// The ledger's directory.
        dir: PathBuf,
        /// Where the backup is.
        out: PathBuf,
    },
    /// Make a ledger's directory from a backup. An aggregator that goes on from an old backup forks its log: show the newest
    /// checkpoints that anybody has.
    Restore(Restore),
    /// Serve a ledger's directory over HTTP (C2SP tlog-tiles), read-only. Its aggregator may be running.
    #[cfg(feature = "full")]
    Serve {
        /// The ledger's directory.
        dir: PathBuf,
        /// Address to listen on; port 0 takes a free one. Traffic is not encrypted: put a TLS proxy before it.
        #[arg(long, default_value = "127.0.0.1:7073")]
        listen: std::net::SocketAddr,
    },
    /// Check that a ledger's directory is whole: entries, rules, tree, checkpoints, and every blob that is there. Proofs are
    /// for `zk0 audit replay`. Exit code 0 when it is, 1 when not.
    Fsck {
        /// The ledger's directory.
        dir: PathBuf,
    },
}

/// `zk0 ledger import`.
#[derive(Debug, clap::Args)]
pub struct Import {
    /// An export, or the address of a served log.
    from: String,
    /// The ledger's directory to make or bring up to date.
    dir: PathBuf,
    #[command(flatten)]
    trust: TrustOptions,
}

/// `zk0 ledger restore`.
#[derive(Debug, clap::Args)]
pub struct Restore {
    /// The backup.
    backup: PathBuf,
    /// The ledger's directory to make; it has to be missing or empty.
    dir: PathBuf,
    /// A checkpoint of the log that somebody has: a file, a directory with a file `checkpoint` (what was lost, an export, a
    /// mirror), the address of a served log, or of a witness' last checkpoint. The backup has to have all that it covers.
    #[arg(
        long,
        value_name = "FILE|DIR|ADDRESS",
        required_unless_present = "no_newer_checkpoint_exists"
    )]
    checkpoint: Vec<String>,
    /// You know that the log signed nothing after the backup was made.
    #[arg(long)]
    no_newer_checkpoint_exists: bool,
    /// The network it has to be.
    #[arg(long)]
    network: Option<Digest>,
}

/// Whom to trust.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TrustOptions {
    /// The network that it has to be, if you know it by other means.
    #[arg(long)]
    pub network: Option<Digest>,
    /// A file with the witnesses whose cosignatures have to be on the checkpoint (a C2SP tlog-policy). Without this option, the
    /// cosignatures that the network's rules ask for have to be there, wherever the whole log is read.
    #[arg(long, value_name = "FILE")]
    pub witness_policy: Option<PathBuf>,
}

impl TrustOptions {
    /// Reads the witness policy.
    pub fn read(&self) -> Result<Trust> {
        Ok(Trust {
            network: self.network,
            witness_policy: self
                .witness_policy
                .as_deref()
                .map(read_witness_policy)
                .transpose()?,
        })
    }
}

/// Runs the command; `false` when something does not hold.
pub fn run(command: &Command) -> Result<bool> {
    match command {
        Command::Vkey { from } => {
            let genesis = genesis(source(from)?.as_ref(), None)?;
            println!("{}", genesis.verifier_key()?);
        }
        Command::Export { dir, out } => {
            let view = Publication::open(dir, None)?;
            let done = export(&view, out)?;
            println!(
                "{} entries published; wrote {} tiles and {} blobs to {}",
                done.entries,
                done.tiles,
                done.blobs,
                out.display()
            );
            if done.missing_blobs > 0 {
                println!("{} public blobs are not kept here", done.missing_blobs);
            }
        }
        Command::Import(options) => import(options)?,
        Command::Backup { dir, out } => {
            let done = backup::backup(dir, out)?;
            copied(&done);
            println!("backed up to {}", out.display());
        }
        Command::Restore(options) => {
            let known = options
                .checkpoint
                .iter()
                .map(|from| known_checkpoint(from))
                .collect::<Result<Vec<_>>>()?;
            let network = options.network.as_ref();
            let done = backup::restore(&options.backup, &options.dir, network, &known)?;
            copied(&done);
            println!("restored to {}", options.dir.display());
            if known.is_empty() {
                println!(
                    "WARNING      if the log has signed a checkpoint of more than {} entries, starting its aggregator now \
                     forks it",
                    done.entries
                );
            }
        }
        #[cfg(feature = "full")]
        Command::Serve { dir, listen } => serve(dir, *listen)?,
        Command::Fsck { dir } => return fsck(dir),
    }
    Ok(true)
}

fn import(options: &Import) -> Result<()> {
    let source = source(&options.from)?;
    let trust = options.trust.read()?;
    let done = mirror(
        source.as_ref(),
        &options.dir,
        trust.witness_policy.as_ref(),
        trust.network.as_ref(),
    )?;
    copied(&done);
    Ok(())
}

fn copied(done: &Mirrored) {
    println!("network {}", done.network);
    println!(
        "{} entries, {} of them new; {} blobs new",
        done.entries, done.new_entries, done.new_blobs
    );
    if done.missing_blobs > 0 {
        println!(
            "{} blobs are not there: not public yet, or not kept",
            done.missing_blobs
        );
    }
}

/// The text of a checkpoint that somebody has.
fn known_checkpoint(from: &str) -> Result<Vec<u8>> {
    let path = Path::new(from);
    if from.starts_with("http://") || from.starts_with("https://") {
        // A log's address, or that of the checkpoint itself.
        let base = from.strip_suffix("/checkpoint").unwrap_or(from);
        let text = Web::at(base)?.get("checkpoint", MAX_NOTE_BYTES as u64)?;
        return text.with_context(|| format!("{base}/checkpoint is not there"));
    }
    match path.is_dir() {
        true => read_bounded(&folder::checkpoint(path), MAX_NOTE_BYTES),
        false => read_bounded(path, MAX_NOTE_BYTES),
    }
}

fn fsck(dir: &Path) -> Result<bool> {
    let report = replay(dir, None, &mut BlobCheck);
    let verdict = match Publication::open(dir, None) {
        Ok(view) => {
            println!("published    {} entries", view.checkpoint().size);
            report.verdict
        }
        Err(error) => {
            println!("FAULT        {error}");
            Verdict::Failed
        }
    };
    println!("entries      {}", report.entries);
    for finding in &report.findings {
        println!("{:<12} {}", format!("{:?}", finding.severity), finding.text);
    }
    println!(
        "{}",
        match verdict {
            Verdict::Verified => "WHOLE        proofs were not checked: that is `zk0 audit replay`",
            Verdict::Failed => "DAMAGED      see above",
        }
    );
    Ok(verdict == Verdict::Verified)
}

/// Reads a policy file.
pub fn read_witness_policy(path: &Path) -> Result<WitnessPolicy> {
    let text = String::from_utf8(read_bounded(path, MAX_POLICY_BYTES)?)
        .with_context(|| format!("reading the witness policy {}", path.display()))?;
    WitnessPolicy::parse(&text).with_context(|| path.display().to_string())
}

pub(crate) fn read_bounded(path: &Path, limit: usize) -> Result<Vec<u8>> {
    let file = fs::File::open(path).with_context(|| format!("reading {}", path.display()))?;
    let mut bytes = Vec::new();
    file.take(limit as u64 + 1)
        .read_to_end(&mut bytes)
        .with_context(|| format!("reading {}", path.display()))?;
    if bytes.len() > limit {
        bail!("{} has more than {limit} bytes", path.display());
    }
    Ok(bytes)
}

#[cfg(feature = "full")]
fn serve(dir: &Path, listen: std::net::SocketAddr) -> Result<()> {
    use zk0_aggregator::publish::{http, log_server::LogServer};
    let server = LogServer::new(dir);
    match server.newest() {
        // It will be, once the witnesses have cosigned.
        Ok(_) | Err(zk0_ledger::published::publication::PublicationError::NotCosigned(_)) => {}
        Err(error) => return Err(error.into()),
    }
    crate::serve_http(
        "log",
        listen,
        std::sync::Arc::new(server),
        http::Limits::default(),
    )
}
