//! `zk0 audit prove` and `verify-proof`: a file that proves that an entry is in a log.

use crate::ledger::TrustOptions;
use crate::output::{print, println};
use anyhow::{Context, Result};
use std::io::ErrorKind;
use std::path::PathBuf;
use zk0_audit::log_source::{open_log, WrongUsage};
use zk0_audit::report::describe::{describe, printable};
use zk0_files::{atomic_file, bounded_file};
use zk0_ledger::witness_policy_file;
use zk0_protocol::tlog::tlog_proof::{TlogProof, MAX_PROOF_BYTES};
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// `zk0 audit prove`.
#[derive(Debug, clap::Args)]
pub struct AuditProveOptions {
    /// A ledger's folder, an export of one, or the address of a served log.
    from: String,
    /// The number of the entry, counted from 0.
    index: u64,
    /// Write the proof to this file [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    trust: TrustOptions,
}

/// `zk0 audit verify-proof`.
#[derive(Debug, clap::Args)]
pub struct Verify {
    /// The file with the proof.
    file: PathBuf,
    /// The log's verifier key, as `zk0 ledger vkey` prints it. It is not needed if the witness policy names the log.
    #[arg(long, required_unless_present = "witness_policy")]
    log_key: Option<VerifierKey>,
    /// Accept the proof only if the witnesses that this file names have cosigned its checkpoint (a C2SP tlog-policy).
    #[arg(long, value_name = "FILE")]
    witness_policy: Option<PathBuf>,
}

/// Makes a proof.
pub fn prove(options: &AuditProveOptions) -> Result<()> {
    let index = options.index;
    let proof = open_log(&options.from, &options.trust.read()?, |log, key, policy| {
        let proof = log.prove(index)?;
        // Only a valid proof is handed out.
        proof.verify(key, policy)?;
        anyhow::Ok(proof)
    })?;
    let text = proof.encode();
    match &options.out {
        Some(path) => {
            atomic_file::replace(path, &text).with_context(|| format!("writing {}", path.display()))
        }
        None => {
            print!("{}", String::from_utf8_lossy(&text));
            Ok(())
        }
    }
}

/// Checks a proof. Returns `false` if it does not hold.
pub fn verify(options: &Verify) -> Result<bool> {
    let file = &options.file;
    let policy = match &options.witness_policy {
        Some(path) => witness_policy_file::read(path)
            .map_err(|error| WrongUsage(format!("--witness-policy {error}")))?,
        None => WitnessPolicy::none(),
    };
    let keys: Vec<&VerifierKey> = match &options.log_key {
        Some(key) if key.role() == Role::Log => vec![key],
        Some(key) => {
            let name = key.name();
            return Err(WrongUsage(format!(
                "{name} is the key of a witness; give the key of a log"
            ))
            .into());
        }
        None => policy.logs().iter().collect(),
    };
    if keys.is_empty() {
        return Err(WrongUsage(
            "the witness policy does not name the log: give the log's key with --log-key".into(),
        )
        .into());
    }
    let proof = match bounded_file::read(file, MAX_PROOF_BYTES as u64) {
        Ok(bytes) => TlogProof::decode(&bytes).map_err(|error| error.to_string()),
        // No proof is so long.
        Err(error) if error.kind() == ErrorKind::FileTooLarge => Err(error.to_string()),
        Err(error) => return Err(error).with_context(|| format!("reading {}", file.display())),
    };
    let proof = match proof {
        Ok(proof) => proof,
        Err(why) => {
            println!("FAILED       {}: {}", file.display(), printable(&why));
            return Ok(false);
        }
    };
    let mut refused = Vec::new();
    for key in keys {
        match proof.verify(key, &policy) {
            Ok((witnessed, entry)) => {
                println!("log          {}", key.name());
                println!(
                    "entry        {} of {}",
                    proof.index, witnessed.checkpoint.size
                );
                println!("root         {}", witnessed.checkpoint.root);
                println!("states         {}", printable(&describe(&entry)));
                for (name, time_s) in witnessed.cosigners {
                    println!("cosigned by  {name} at {time_s} (Unix seconds)");
                }
                println!("VERIFIED     the entry is in the log");
                return Ok(true);
            }
            Err(error) => refused.push(format!("{}: {error}", key.name())),
        }
    }
    for why in refused {
        println!("FAILED       {why}");
    }
    Ok(false)
}
