//! `zk0 governance`: propose, vote, dispute, change a key.

use crate::{aggregator::Enrolment, keys};
use anyhow::{ensure, Context, Result};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::{fs, path::PathBuf};
use tokio::runtime::Runtime;
use zk0_circuits::{Digest, NodeId};
use zk0_node::client::{GovernanceInfo, Node};
use zk0_protocol::{
    entries::{
        entry::Body,
        member::NodeEnrolled,
        proposal::{Action, Ballot},
        signed::{Dispute, Evidence, KeyRotation, KeyTakeover, Proposal, Signed, Vote},
    },
    Rules,
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make a governor's key and print its identity, for the rules.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
    },
    /// Print the rules in force and the open proposals. Proposals come with receipts; how votes stand is the aggregator's
    /// word, and `zk0 audit replay` counts them again.
    Status {
        #[command(flatten)]
        network: Network,
        /// Print the rules alone, as JSON: edit them and propose them with `propose rules`.
        #[arg(long)]
        rules: bool,
    },
    /// Propose a change. It is open for votes as long as the rules say.
    Propose {
        #[command(flatten)]
        signer: Signer,
        /// A line for people.
        #[arg(long)]
        title: String,
        /// Why, for people.
        #[arg(long, default_value = "")]
        text: String,
        #[command(subcommand)]
        change: Change,
    },
    /// Vote on a proposal. A vote is final.
    Vote {
        #[command(flatten)]
        signer: Signer,
        /// The proposal's number.
        proposal: u64,
        /// For it, against it, or neither; veto stops it, in its time lock alone.
        ballot: BallotArg,
    },
    /// Say that an accepted contribution is false. Without a document it is verified again, and that decides.
    Dispute {
        #[command(flatten)]
        signer: Signer,
        /// The entry that accepted the contribution.
        contribution: u64,
        /// What shows it, for those who govern to judge: its SHA-256 goes on the ledger, the document itself is for you to
        /// publish.
        #[arg(long)]
        document: Option<PathBuf>,
    },
    /// Hand a node's place over to another key of its own.
    RotateKey {
        #[command(flatten)]
        signer: Signer,
        /// The new key, as `zk0 node keygen` makes it.
        #[arg(long)]
        new_key: PathBuf,
    },
}

/// The network that is meant.
#[derive(Debug, clap::Args)]
pub struct Network {
    /// The aggregator, such as http://127.0.0.1:7071.
    #[arg(long)]
    aggregator: String,
    /// The network's id, as its operator published it.
    #[arg(long)]
    network: Digest,
}

/// The network that is meant, and who signs.
#[derive(Debug, clap::Args)]
pub struct Signer {
    #[command(flatten)]
    network: Network,
    /// The key to sign with: a governor's or a node's.
    #[arg(long)]
    key: PathBuf,
}

/// What a proposal changes.
#[derive(Debug, clap::Subcommand)]
pub enum Change {
    /// All the rules, from a JSON file: see `status --rules`.
    Rules {
        /// The file.
        file: PathBuf,
    },
    /// A node joins.
    Enrol {
        /// NAME=IDENTITY, as `zk0 node keygen` prints it.
        node: Enrolment,
    },
    /// A node may not contribute until it is reinstated.
    Suspend {
        /// Its identity.
        node: NodeId,
    },
    /// A suspended node may contribute again.
    Reinstate {
        /// Its identity.
        node: NodeId,
    },
    /// A node may never contribute again.
    Revoke {
        /// Its identity.
        node: NodeId,
    },
    /// Another key takes the place of one that is lost or stolen.
    ReplaceKey {
        /// The node's identity.
        node: NodeId,
        /// The new one.
        with: NodeId,
    },
    /// A dispute about what a document says is decided.
    Judge {
        /// The entry that raised it.
        dispute: u64,
        /// Whether the contribution was false.
        verdict: Verdict,
    },
}

/// How a dispute is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Verdict {
    /// The contribution was false: its credits are taken back, its node is suspended.
    Upheld,
    /// It stands.
    Dismissed,
}

/// One voter's say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BallotArg {
    /// For it.
    For,
    /// Against it.
    Against,
    /// Neither, but counted towards the quorum.
    Abstain,
    /// Stop it.
    Veto,
}

impl Change {
    fn action(&self) -> Result<Action> {
        Ok(match self {
            Self::Rules { file } => Action::ChangeRules(Box::new(read_rules(file)?)),
            Self::Enrol {
                node: Enrolment { name, node },
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
                upheld: *verdict == Verdict::Upheld,
            },
        })
    }
}

/// Reads rules from a JSON file, and refuses those that no network can live by.
pub fn read_rules(file: &PathBuf) -> Result<Rules> {
    let context = || format!("reading rules from {}", file.display());
    let text = fs::read_to_string(file).with_context(context)?;
    let rules: Rules = serde_json::from_str(&text).with_context(context)?;
    rules
        .check()
        .map_err(anyhow::Error::msg)
        .with_context(context)?;
    Ok(rules)
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    if let Command::Keygen { file } = command {
        println!("{}", keys::generate(file)?);
        return Ok(());
    }
    Runtime::new()
        .context("starting the runtime")?
        .block_on(online(command))
}

async fn online(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { .. } => Ok(()),
        Command::Status { network, rules } => {
            // Nothing is signed: any key connects.
            let key = SigningKey::from_bytes(&keys::random()?);
            let mut node = connect(network, key).await?;
            let info = node.governance().await?;
            match rules {
                true => println!("{}", serde_json::to_string_pretty(&info.rules)?),
                false => print!("{}", status(&info)?),
            }
            Ok(())
        }
        Command::Propose {
            signer,
            title,
            text,
            change,
        } => {
            let action = change.action()?;
            let (mut node, key) = signer.connect().await?;
            let number = node.governance().await?.next_proposal;
            let proposal = Proposal {
                network: *node.network(),
                number,
                proposer: node.id(),
                title: title.clone(),
                text: text.clone(),
                action,
            };
            let body = Body::Proposed(Signed::new(proposal, &key));
            let entry = node.record(body).await?;
            println!("proposal {number} is entry {entry}");
            Ok(())
        }
        Command::Vote {
            signer,
            proposal,
            ballot,
        } => {
            let (mut node, key) = signer.connect().await?;
            let vote = Vote {
                network: *node.network(),
                proposal: *proposal,
                voter: node.id(),
                ballot: match ballot {
                    BallotArg::For => Ballot::For,
                    BallotArg::Against => Ballot::Against,
                    BallotArg::Abstain => Ballot::Abstain,
                    BallotArg::Veto => Ballot::Veto,
                },
            };
            let entry = node.record(Body::Voted(Signed::new(vote, &key))).await?;
            println!("the vote is entry {entry}");
            Ok(())
        }
        Command::Dispute {
            signer,
            contribution,
            document,
        } => {
            let evidence = match document {
                None => Evidence::Verification,
                Some(path) => {
                    let bytes = fs::read(path)
                        .with_context(|| format!("reading the document {}", path.display()))?;
                    Evidence::Document(Digest(Sha256::digest(&bytes).into()))
                }
            };
            let (mut node, key) = signer.connect().await?;
            let dispute = Dispute {
                network: *node.network(),
                disputer: node.id(),
                contribution: *contribution,
                evidence,
            };
            let entry = node
                .record(Body::Disputed(Signed::new(dispute, &key)))
                .await?;
            println!("the dispute is entry {entry}");
            Ok(())
        }
        Command::RotateKey { signer, new_key } => {
            let new = keys::read(new_key)?;
            let (mut node, key) = signer.connect().await?;
            let rotation = KeyRotation {
                network: *node.network(),
                node: node.id(),
                with: keys::identity(&new),
            };
            ensure!(
                rotation.with != rotation.node,
                "the new key is the present one: make another with `zk0 node keygen`"
            );
            let entry = node
                .record(Body::KeyRotated {
                    rotation: Signed::new(rotation, &key),
                    takeover: Signed::new(KeyTakeover { rotation }, &new),
                })
                .await?;
            println!(
                "entry {entry}: the node is {} from now on; join with its new key",
                rotation.with
            );
            Ok(())
        }
    }
}

async fn connect(network: &Network, key: SigningKey) -> Result<Node> {
    Node::connect(network.aggregator.clone(), network.network, key)
        .await
        .with_context(|| format!("connecting to {}", network.aggregator))
}

impl Signer {
    async fn connect(&self) -> Result<(Node, SigningKey)> {
        let key = keys::read(&self.key)?;
        Ok((connect(&self.network, key.clone()).await?, key))
    }
}

fn status(info: &GovernanceInfo) -> Result<String> {
    let mut text = serde_json::to_string_pretty(&info.rules)? + "\n\n";
    if info.proposals.is_empty() {
        text.push_str("no proposal is open\n");
    }
    for (proposal, open) in &info.proposals {
        let left = |until: u64| format!("{} s", until.saturating_sub(info.now_ms).div_ceil(1000));
        let phase = match info.now_ms {
            now if now <= open.voting_ends_ms => {
                format!("votes for another {}", left(open.voting_ends_ms))
            }
            now if now <= open.veto_ends_ms => {
                format!("vetoes for another {}", left(open.veto_ends_ms))
            }
            _ => "to be settled before the next round".into(),
        };
        text.push_str(&format!(
            "proposal {}: {}\n  {}\n  by {}; {phase}\n  for {}, against {}, abstained {}, vetoes {}, of {}\n",
            proposal.number,
            proposal.title,
            describe(&proposal.action)?,
            proposal.proposer,
            open.for_it,
            open.against,
            open.abstained,
            open.vetoes,
            open.electorate,
        ));
        if !proposal.text.is_empty() {
            let shown = proposal.text.escape_debug().to_string();
            text.push_str(&format!("  {shown}\n"));
        }
    }
    Ok(text)
}

fn describe(action: &Action) -> Result<String> {
    Ok(match action {
        Action::ChangeRules(rules) => format!("rules: {}", serde_json::to_string(rules)?),
        Action::Enrol(enrolled) => format!("enrol {} ({})", enrolled.name, enrolled.node),
        Action::Suspend(node) => format!("suspend {node}"),
        Action::Reinstate(node) => format!("reinstate {node}"),
        Action::Revoke(node) => format!("revoke {node}"),
        Action::ReplaceKey { node, with } => format!("replace the key of {node} with {with}"),
        Action::JudgeDispute { dispute, upheld } => format!(
            "{} the dispute of entry {dispute}",
            if *upheld { "uphold" } else { "dismiss" }
        ),
    })
}
