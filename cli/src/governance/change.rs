//! The changes that can be proposed.

use crate::aggregator::{read_rules, NodeToEnrol};
use anyhow::{Context, Result};
use std::path::PathBuf;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::{Mode, NodeId};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::program::{Program, OUR_SP1};
use zk0_protocol::entries::proposal::Action;

/// What a proposal changes.
#[derive(Debug, clap::Subcommand)]
pub enum Change {
    /// Replace the rules by those of a JSON file. `zk0 governance status --rules` prints the rules in force as such a file.
    Rules {
        /// The JSON file.
        file: PathBuf,
    },
    /// Let a node join.
    Enrol {
        /// NAME=IDENTITY. `zk0 node keygen` prints the identity; the name is for people.
        node: NodeToEnrol,
    },
    /// Let a node contribute no more until it is reinstated.
    Suspend {
        /// The node's identity.
        node: NodeId,
    },
    /// Let a suspended node contribute again.
    Reinstate {
        /// The node's identity.
        node: NodeId,
    },
    /// Let a node never contribute again.
    Revoke {
        /// The node's identity.
        node: NodeId,
    },
    /// Replace a node's key that is lost or stolen.
    ReplaceKey {
        /// The node's identity.
        node: NodeId,
        /// The identity of the new key.
        with: NodeId,
    },
    /// Decide a dispute that rests on a document.
    Judge {
        /// The number of the entry that raised the dispute.
        dispute: u64,
        /// Whether the contribution was false.
        verdict: DisputeVerdict,
    },
    /// Let proofs be of another guest program from the next round on. Nodes and the aggregator need a release of zk0 that has it.
    Program {
        /// The program's verifying key, in hexadecimal. Without it, you propose the program of the release of zk0 that you run.
        key: Option<String>,
        /// The release of SP1 whose verifier decides about the proofs.
        #[arg(long, default_value = OUR_SP1)]
        sp1: String,
    },
    /// Let the next round start from the weights that an earlier round ended with.
    RestoreWeights {
        /// The number of that round.
        round: u64,
    },
}

/// The decision on a dispute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DisputeVerdict {
    /// The contribution was false. Its credits are taken back, and its node is suspended.
    Upheld,
    /// The contribution stands.
    Dismissed,
}

impl Change {
    /// The change as a ledger's action, in this proving mode.
    pub fn action(&self, mode: Mode) -> Result<Action> {
        Ok(match self {
            Self::Rules { file } => {
                let rules = read_rules(file)?;
                let context = || format!("reading rules from {}", file.display());
                let checked = rules.check_in(mode).map_err(anyhow::Error::msg);
                checked.with_context(context)?;
                Action::ChangeRules(Box::new(rules))
            }
            Self::Enrol {
                node: NodeToEnrol { name, node },
            } => Action::Enrol(NodeEnrolled {
                node: *node,
                name: name.clone(),
            }),
            Self::Suspend { node } => Action::Suspend(*node),
            Self::Reinstate { node } => Action::Reinstate(*node),
            Self::Revoke { node } => Action::Revoke(*node),
            Self::ReplaceKey { node, with } => Action::ReplaceKey {
                node: *node,
                with: *with,
            },
            Self::Judge { dispute, verdict } => Action::JudgeDispute {
                dispute: *dispute,
                upheld: *verdict == DisputeVerdict::Upheld,
            },
            Self::Program { key, sp1 } => {
                let program = Program {
                    key: match key {
                        Some(key) => hex::decode(key)
                            .with_context(|| format!("the key {key:?} is not hexadecimal"))?,
                        None => verifying_key(mode).to_vec(),
                    },
                    sp1: sp1.clone(),
                };
                program.check()?;
                Action::ReplaceProgram(program)
            }
            Self::RestoreWeights { round } => Action::RestoreWeights { round: *round },
        })
    }
}
