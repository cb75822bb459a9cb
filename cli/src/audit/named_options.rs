//! Options that name what the auditor answers for.

use anyhow::{Context, Result};
use zk0_audit::Named;
use zk0_circuits::Digest;

/// What you answer for.
#[derive(Debug, clap::Args)]
pub struct NamedOptions {
    /// Accept proofs of the guest program with this verifying key, besides that of this release. `zk0 audit show` prints a network's key.
    /// Use it only if you know what that program proves. Repeat the option for more programs.
    #[arg(long = "program", value_name = "KEY")]
    programs: Vec<String>,
    /// Accept an evaluation with this digest, besides that of this release. `zk0 audit show` prints a network's. Repeat the option for
    /// more evaluations.
    #[arg(long = "evaluation", value_name = "DIGEST")]
    evaluations: Vec<Digest>,
}

impl NamedOptions {
    /// Reads the keys.
    pub fn read(&self) -> Result<Named> {
        let key = |text: &String| {
            hex::decode(text).with_context(|| format!("--program {text:?} is not hexadecimal"))
        };
        Ok(Named {
            programs: self.programs.iter().map(key).collect::<Result<_>>()?,
            evaluations: self.evaluations.iter().copied().collect(),
        })
    }
}
