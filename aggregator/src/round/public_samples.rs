//! Whether the public samples of the rules are present and usable.

use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::state::State;
use zk0_verifier::public_samples::PublicSampleFile;
use zk0_verifier::Evaluation;

/// Checks that the public samples of `rules` are among `blobs`, and usable in the network of `genesis`.
pub fn check_public_samples(genesis: &Genesis, rules: &Rules, blobs: &Blobs) -> Result<(), String> {
    let Some(rule) = rules.public_samples else {
        return Ok(());
    };
    let limit = BlobKind::PublicSamples.max_bytes(rules);
    let bytes = blobs.get(&rule.blob, limit).map_err(|error| {
        format!("the public samples that the rules name cannot be read: {error}; `zk0 aggregator samples` puts such samples into the ledger's folder")
    })?;
    let evaluation = Evaluation::of_genesis(genesis).map_err(|error| error.to_string())?;
    let read = PublicSampleFile::read(evaluation.format().spec(), rule, &bytes);
    read.map(drop).map_err(|error| error.to_string())
}

/// The public samples of the next round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UncheckedSamples {
    rule: PublicSamples,
    round: u64,
    genesis: Genesis,
    rules: Rules,
    blobs: Blobs,
}

impl UncheckedSamples {
    /// Those of the round after `state`, if the rules name some.
    pub(super) fn of(state: &State, blobs: &Blobs) -> Option<Self> {
        Some(Self {
            rule: state.rules().public_samples?,
            round: state.next_round(),
            genesis: state.genesis().clone(),
            rules: state.rules().clone(),
            blobs: blobs.clone(),
        })
    }

    pub(super) fn rule(&self) -> PublicSamples {
        self.rule
    }

    /// Reads and checks them. Returns why the round cannot open. The file may have a gigabyte: run this away from the aggregator.
    pub fn check(&self) -> Result<(), String> {
        let checked = check_public_samples(&self.genesis, &self.rules, &self.blobs);
        checked.map_err(|why| format!("round {} cannot open: {why}", self.round))
    }
}
