//! A policy folder's model card: `README.md` with the Hub's header.

use crate::hub::Repository;
use crate::publish::round_facts::{AcceptedContribution, RoundFacts};
use anyhow::{bail, Context, Result};
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io;
use std::path::Path;
use zk0_files::atomic_file;
use zk0_lerobot::policy_folder::PolicyFolder;

/// What the card states besides what the ledger states.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct CardOptions {
    /// The licence of the published policy, by the Hub's identifier, such as apache-2.0. Without it, the model card names none.
    #[arg(long, value_name = "LICENCE", value_parser = identifier)]
    hf_license: Option<String>,
    /// The model on the Hub that the network was founded with, such as lerobot/smolvla_base. The model card names it.
    #[arg(long, value_name = "OWNER/NAME", value_parser = identifier)]
    hf_base_model: Option<String>,
    /// A dataset on the Hub that a node trained on. The model card names it. Repeat the option for more datasets.
    #[arg(long = "hf-dataset", value_name = "OWNER/NAME", value_parser = identifier)]
    hf_datasets: Vec<String>,
}

/// Goes into the header as it is.
fn identifier(text: &str) -> Result<String> {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._-/".contains(&byte);
    if !text.is_empty() && text.len() <= 200 && text.bytes().all(plain) {
        Ok(text.into())
    } else {
        bail!("{text:?} is no identifier of the Hub: it has letters, digits, and . _ - / alone")
    }
}

impl CardOptions {
    /// Writes or replaces the card in `folder`, which is published as `to`.
    ///
    /// # Errors
    /// The weights cannot be read, or the card cannot be written.
    pub fn write(&self, folder: &Path, to: &Repository, facts: &RoundFacts) -> Result<()> {
        let weights = sha256(&folder.join("model.safetensors"))?;
        let normalisation = match PolicyFolder::open(folder)?.stats()? {
            Some(_) => "the statistics in this folder; each node trained with those of its own recording, so compare them with your robot's",
            None => "this folder has no statistics; each node trained with those of its own recording, and you need yours",
        };
        let card = folder.join("README.md");
        atomic_file::replace(
            &card,
            self.text(to, facts, &weights, normalisation).as_bytes(),
        )
        .with_context(|| format!("writing {}", card.display()))
    }

    fn header(&self) -> String {
        let mut header = "---\nlibrary_name: lerobot\npipeline_tag: robotics\n".to_owned();
        if let Some(license) = &self.hf_license {
            header += &format!("license: {license}\n");
        }
        if let Some(model) = &self.hf_base_model {
            header += &format!("base_model: {model}\n");
        }
        if !self.hf_datasets.is_empty() {
            header += "datasets:\n";
        }
        for dataset in &self.hf_datasets {
            header += &format!("- {dataset}\n");
        }
        header + "tags:\n- robotics\n- lerobot\n- smolvla\n- federated-learning\n- zk0\n---\n"
    }

    fn text(
        &self,
        to: &Repository,
        facts: &RoundFacts,
        model: &str,
        normalisation: &str,
    ) -> String {
        let (name, round) = (plain(&facts.network), facts.round);
        let taken = match (facts.contributions.len(), facts.is_taken) {
            (0, _) => "Nobody contributed in this round, so the weights are those of the round before.",
            (_, true) => "The updates of these nodes were combined to the weights of this policy.",
            (_, false) => "The result of these updates was not taken, so the weights are those of the round before.",
        };
        format!(
            "{header}
# {name}, round {round}

A SmolVLA policy that robots trained together, without sharing their recordings. An update counts in the network `{name}` only if an SP1 proof shows that
it lowered the flow-matching loss on samples that the node had committed to before the round, and could not choose.

```python
from lerobot.policies.smolvla.modeling_smolvla import SmolVLAPolicy

policy = SmolVLAPolicy.from_pretrained(\"{to}\")
```

| what | value |
| --- | --- |
| network | `{name}` |
| network's id | `{id}` |
| verifier key of its log | `{log_key}` |
| round, counted from 0 | {round} |
| entry that closed it | {closed_entry} |
| SHA-256 of the global weights on the ledger | `{weights}` |
| SHA-256 of `model.safetensors` | `{model}` |
| states and actions are normalised with | {normalisation} |

## Who contributed?

{taken}

{contributions}
The losses are mean squared errors on the samples of the claim, which the proof shows. A proof does not show that a recording is real.

## How do I verify it?

With the network's log, `zk0`, and the policy folder that the network was founded with, anybody verifies each proof and writes these weights again. No
account and no permission is needed:

```sh
zk0 ledger import ADDRESS-OF-THE-LOG ledger --network {id}
zk0 audit replay ledger --network {id}
zk0 publish hub ledger --round {round} --policy POLICY --repo-id {to} --dry-run again
sha256sum again/model.safetensors    # {model}
```
",
            header = self.header(),
            id = facts.id,
            log_key = facts.log_key,
            closed_entry = facts.closed_entry,
            weights = facts.weights,
            contributions = table(&facts.contributions),
        )
    }
}

fn table(contributions: &[AcceptedContribution]) -> String {
    if contributions.is_empty() {
        return String::new();
    }
    let mut table =
        "| node | identity | entry | loss before | loss after |\n| --- | --- | --- | --- | --- |\n"
            .to_owned();
    for one in contributions {
        let losses = match one.losses {
            Some((before, after)) => format!("{before:.5} | {after:.5}"),
            None => "not disclosed | not disclosed".into(),
        };
        let (name, node, entry) = (plain(&one.name), one.node, one.entry);
        table += &format!("| {name} | `{node}` | {entry} | {losses} |\n");
    }
    table + "\n"
}

/// Others chose the name: it must not act as Markdown or HTML.
fn plain(name: &str) -> String {
    let shown = |c: char| {
        if c.is_alphanumeric() || " .-/:".contains(c) {
            c
        } else {
            '_'
        }
    };
    name.chars().take(100).map(shown).collect()
}

fn sha256(path: &Path) -> Result<String> {
    let hashed = || -> io::Result<_> {
        let mut hash = Sha256::new();
        io::copy(&mut File::open(path)?, &mut hash)?;
        Ok(hash.finalize())
    };
    let hash = hashed().with_context(|| format!("reading {}", path.display()))?;
    Ok(hex::encode(hash))
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::{Digest, NodeId};

    #[test]
    fn the_card_says_what_is_known_and_keeps_foreign_names_harmless() {
        let facts = RoundFacts {
            network: "arms".into(),
            id: Digest([1; 32]),
            log_key: "arms+1234+key".into(),
            round: 7,
            closed_entry: 99,
            weights: Digest([2; 32]),
            is_taken: true,
            contributions: vec![AcceptedContribution {
                node: NodeId([3; 32]),
                name: "<b>|`Zoë's arm`\n---".into(),
                entry: 97,
                losses: Some((0.5, 0.25)),
            }],
        };
        let to: Repository = "arms/policy".parse().unwrap();
        let options = CardOptions {
            hf_license: Some("apache-2.0".into()),
            hf_base_model: Some("lerobot/smolvla_base".into()),
            hf_datasets: vec!["a/b".into(), "c/d".into()],
        };
        let text = options.text(&to, &facts, "abcd", "its statistics");
        let header = "---\nlibrary_name: lerobot\npipeline_tag: robotics\nlicense: apache-2.0\nbase_model: lerobot/smolvla_base\ndatasets:\n- a/b\n- c/d\ntags:\n";
        assert!(text.starts_with(header), "{text}");
        let row = format!(
            "| _b___Zoë_s arm__--- | `{}` | 97 | 0.50000 | 0.25000 |\n",
            "03".repeat(32)
        );
        assert!(text.contains(&row), "{text}");
        assert!(
            text.contains("normalised with | its statistics |"),
            "{text}"
        );
        let unknown = CardOptions::default().text(&to, &facts, "abcd", "none");
        for key in ["license:", "base_model:", "datasets:"] {
            assert!(!unknown.contains(key), "{unknown}");
        }
        assert!(identifier("a b").is_err() && identifier("a\nb").is_err());
    }
}
