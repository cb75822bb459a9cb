//! `zk0 governance`: propose, vote, dispute, change a key.

mod change;
mod new_witnesses;
mod status;

use crate::keys;
use crate::network::{NetworkChoice, Signer};
use crate::output::{print, println};
use crate::serve::online;
use anyhow::{Context, Result};
use change::Change;
use ed25519_dalek::SigningKey;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_node::state_files;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::Evidence;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum GovernanceCommand {
    /// Make a governor's key and print its identity. A network's rules name its governors by their identities.
    Keygen {
        /// Write the key to this file. An existing file is kept.
        file: PathBuf,
    },
    /// Print the rules and the guest program in force, and the open proposals. The aggregator proves that the proposals are on its ledger,
    /// but it only states how the votes stand; `zk0 audit replay` counts the votes again.
    Status {
        #[command(flatten)]
        network: NetworkChoice,
        /// Print only the rules, as JSON. You can edit them, and propose them with `zk0 governance propose rules`.
        #[arg(long)]
        rules: bool,
    },
    /// Propose a change. Votes on it are taken for as long as the rules state.
    Propose {
        #[command(flatten)]
        signer: Signer,
        /// A line that tells people what you propose.
        #[arg(long)]
        title: String,
        /// A text that tells people why.
        #[arg(long, default_value = "")]
        text: String,
        #[command(subcommand)]
        change: Change,
    },
    /// Vote on a proposal. The command prints the proposal that the vote is for. You cannot change a vote.
    Vote {
        #[command(flatten)]
        signer: Signer,
        /// The proposal's number.
        proposal: u64,
        /// Your vote. A veto stops the proposal; vetoes are taken after the voting, before the change takes effect.
        ballot: BallotArg,
    },
    /// Dispute a contribution that was accepted. Without a document, the aggregator verifies the contribution again, and the result
    /// decides.
    Dispute {
        #[command(flatten)]
        signer: Signer,
        /// The number of the entry that accepted the contribution.
        contribution: u64,
        /// A file that shows that the contribution is false. The governors judge it. The ledger records only its SHA-256, so publish the
        /// file yourself.
        #[arg(long)]
        document: Option<PathBuf>,
    },
    /// Change a node's key. The node keeps its place in the network.
    RotateKey {
        #[command(flatten)]
        signer: Signer,
        /// The file of the new key, made by `zk0 node keygen`.
        #[arg(long)]
        new_key: PathBuf,
    },
}

/// A vote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BallotArg {
    /// For the proposal.
    For,
    /// Against it.
    Against,
    /// Neither for nor against it. The vote counts towards the quorum.
    Abstain,
    /// Stop it.
    Veto,
}

impl From<BallotArg> for Ballot {
    fn from(ballot: BallotArg) -> Self {
        match ballot {
            BallotArg::For => Self::For,
            BallotArg::Against => Self::Against,
            BallotArg::Abstain => Self::Abstain,
            BallotArg::Veto => Self::Veto,
        }
    }
}

/// Runs the command.
pub fn run(command: &GovernanceCommand) -> Result<()> {
    online(answer(command))
}

async fn answer(command: &GovernanceCommand) -> Result<()> {
    match command {
        GovernanceCommand::Keygen { file } => println!("{}", keys::generate(file)?),
        GovernanceCommand::Status { network, rules } => {
            // Nothing is signed, so any key will do.
            let key = SigningKey::from_bytes(&keys::random()?);
            let info = network.connect_for_command(key).await?.governance().await?;
            if *rules {
                println!("{}", serde_json::to_string_pretty(&info.rules)?)
            } else {
                print!("{}", status::status(&info)?)
            }
        }
        GovernanceCommand::Propose {
            signer,
            title,
            text,
            change,
        } => {
            let mut node = signer.connect().await?;
            let action = change.action(node.genesis().mode)?;
            if let Action::ChangeRules(rules) = &action {
                new_witnesses::check(&mut node, rules).await?;
            }
            let proposed = node.propose(title.clone(), text.clone(), action).await?;
            println!("proposal {} is entry {}", proposed.number, proposed.entry);
        }
        GovernanceCommand::Vote {
            signer,
            proposal,
            ballot,
        } => {
            let mut node = signer.connect().await?;
            let info = node.governance().await?;
            let mut open = info.proposals.iter();
            let (proposal, votes) = open
                .find(|(open, _)| open.number == *proposal)
                .with_context(|| format!("proposal {proposal} is not open"))?;
            print!("{}", status::proposal(proposal, votes, info.now_ms)?);
            let entry = node.vote(proposal, (*ballot).into()).await?;
            println!("the vote is entry {entry}");
        }
        GovernanceCommand::Dispute {
            signer,
            contribution,
            document,
        } => {
            let evidence = match document {
                None => Evidence::Verification,
                Some(path) => Evidence::Document(document_digest(path)?),
            };
            let mut node = signer.connect().await?;
            let entry = node.dispute(*contribution, evidence).await?;
            println!("the dispute is entry {entry}");
        }
        GovernanceCommand::RotateKey { signer, new_key } => {
            let new = keys::read(new_key)?;
            let (entry, identity) = signer.connect().await?.rotate_key(&new).await?;
            println!("entry {entry}: this member is {identity} from now on; use its new key");
        }
    }
    Ok(())
}

fn document_digest(path: &Path) -> Result<Digest> {
    let digest = state_files::sha256(path).context("reading the document")?;
    let digest = digest.with_context(|| format!("there is no document {}", path.display()))?;
    Ok(Digest(digest))
}
