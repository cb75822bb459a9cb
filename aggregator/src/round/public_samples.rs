//! Whether the public samples that the rules name are at hand, and can be used.

use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Rules;
use zk0_verifier::public_samples::PublicSampleFile;
use zk0_verifier::Evaluation;

/// Checks that the public samples that `rules` name are among `blobs`, and can be used in the network of `genesis`.
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
