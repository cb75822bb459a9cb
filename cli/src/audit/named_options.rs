//! Options that name what the auditor answers for.

use zk0_audit::TrustedPrograms;
use zk0_circuits::Digest;

/// What you answer for.
#[derive(Debug, clap::Args)]
pub struct NamedOptions {
    /// Accept proofs of the guest program with this verifying key, besides that of this release. `zk0 audit show` prints a network's key.
    /// Use it only if you know what that program proves. Repeat the option for more programs.
    #[arg(long = "program", value_name = "KEY", value_parser = program)]
    programs: Vec<ProgramVkey>,
    /// Accept an evaluation with this digest, besides that of this release. `zk0 audit show` prints a network's. Repeat the option for
    /// more evaluations.
    #[arg(long = "evaluation", value_name = "DIGEST")]
    evaluations: Vec<Digest>,
}

impl NamedOptions {
    /// What they name.
    pub fn named(&self) -> TrustedPrograms {
        let keys = self.programs.iter().map(|program| program.0.clone());
        TrustedPrograms {
            programs: keys.collect(),
            evaluations: self.evaluations.iter().copied().collect(),
        }
    }
}

#[derive(Clone, Debug)]
struct ProgramVkey(Vec<u8>);

fn program(text: &str) -> Result<ProgramVkey, String> {
    let key = hex::decode(text).map_err(|error| format!("it is not hexadecimal: {error}"))?;
    Ok(ProgramVkey(key))
}
