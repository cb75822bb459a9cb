//! `zk0 audit prove` and `verify-proof`: that an entry is in a log, as one file that anybody checks offline.

use crate::ledger::{read_bounded, read_witness_policy, TrustOptions};
use anyhow::{bail, Context, Result};
use std::{fs, io::Write, path::PathBuf};
use zk0_audit::log_source::open_log;
use zk0_audit::report::describe::{describe, printable};
use zk0_protocol::tlog::{
    tlog_proof::{TlogProof, MAX_PROOF_BYTES},
    verifier_key::{Role, VerifierKey},
    witness_policy::WitnessPolicy,
};

/// `zk0 audit prove`.
#[derive(Debug, clap::Args)]
pub struct Prove {
    /// A ledger's directory, an export of one, or the address of a served log.
    from: String,
    /// The entry, counted from 0.
    index: u64,
    /// Where the proof goes; to standard output when absent.
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    trust: TrustOptions,
}

/// `zk0 audit verify-proof`.
#[derive(Debug, clap::Args)]
pub struct Verify {
    /// The proof.
    file: PathBuf,
    /// The log's verifier key, as `zk0 ledger vkey` prints it. A witness policy that names the log makes it unnecessary.
    #[arg(long, required_unless_present = "witness_policy")]
    log_key: Option<VerifierKey>,
    /// Whose cosignatures have to be on the checkpoint (a C2SP tlog-policy file).
    #[arg(long)]
    witness_policy: Option<PathBuf>,
}

/// Makes a proof.
pub fn prove(options: &Prove) -> Result<()> {
    let index = options.index;
    let proof = open_log(&options.from, &options.trust.read()?, |log, key, policy| {
        let proof = log.prove(index)?;
        // Nothing is handed out that does not convince us.
        proof.verify(key, policy)?;
        anyhow::Ok(proof)
    })?;
    let text = proof.encode();
    match &options.out {
        Some(path) => fs::write(path, &text).with_context(|| format!("writing {}", path.display())),
        None => Ok(std::io::stdout().write_all(&text)?),
    }
}

/// Checks a proof; `false` when it does not hold.
pub fn verify(options: &Verify) -> Result<bool> {
    let file = &options.file;
    let policy = options.witness_policy.as_deref();
    let policy = policy.map_or_else(|| Ok(WitnessPolicy::none()), read_witness_policy)?;
    let proof = TlogProof::decode(&read_bounded(file, MAX_PROOF_BYTES)?)
        .with_context(|| format!("reading {}", file.display()))?;
    let keys: Vec<&VerifierKey> = match &options.log_key {
        Some(key) if key.role() == Role::Log => vec![key],
        Some(key) => bail!("{} is a witness' key, not a log's", key.name()),
        None => policy.logs().iter().collect(),
    };
    if keys.is_empty() {
        bail!("the witness policy names no log; give --log-key");
    }
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
                println!("says         {}", printable(&describe(&entry)));
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
