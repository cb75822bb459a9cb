//! What several attacks begin with: a network in its first round, an update that the service can accept, and a real proof.

use super::attack::{Defence, Outcome};
use zk0_circuits::Claim;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rpc::federation::SubmitReply;
use zk0_testkit::aggregator::real_proof::real_proof;
use zk0_testkit::aggregator::{genesis, open_round_of, reason, weights, Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

/// What an attacker is given who could prove the claim: making a proof takes a quarter of an hour, and this test has one. SP1 verifies it,
/// whatever the claim is. Then only the claim that it proves is another one. It is taken out for whoever could prove a claim.
pub const PROOF_OF_ANY_CLAIM: Defence = Defence {
    check: "a proof proves the claim that it comes with",
    out: &[SourceChange {
        file: "verifier/src/proof.rs",
        replacements: &[(
            "        verify(&decoded, &public_values, key)\n",
            "        verify(&decoded, &public_values, key).or_else(|why| match why.code {
            RefusalCode::OtherClaim if OUT => Ok(()),
            _ => Err(why),
        })\n",
        )],
    }],
};

/// A network whose program is that of the real proof, in its first round, with two nodes that have datasets.
pub async fn proving_network(
    change: impl FnOnce(&mut Genesis),
) -> (Network, SigningNode, SigningNode) {
    let mut genesis = genesis();
    genesis.program = real_proof().0.key;
    genesis.rules.max_proof_bytes = 4 << 20;
    change(&mut genesis);
    open_round_of(genesis).await
}

/// An update that is close to the base of the first round, where one weight that the evaluation reads is another one.
pub fn near_base(step: u8) -> Vec<u8> {
    let mut file = weights(0);
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let length = u64::from_le_bytes(*length) as usize;
    let header: serde_json::Value = serde_json::from_slice(&rest[..length]).unwrap();
    let mut tensors = header.as_object().unwrap().iter();
    let (_, tensor) = tensors
        .find(|(name, _)| name.ends_with("mlp.gate_proj.weight"))
        .unwrap();
    let begin = tensor["data_offsets"][0].as_u64().unwrap() as usize;
    // The lowest bit of a value: its tensor keeps its scale.
    file[8 + length + begin + 2 * step as usize] ^= 1;
    file
}

/// Uploads an update, and commits to it.
pub async fn commit(network: &Network, node: &SigningNode, update: &[u8]) {
    node.upload(network, 0, update).await.unwrap();
    node.commit(network, 0, update).await.unwrap();
}

/// Submits a claim with the real proof. The attack has succeeded if the contribution is accepted.
pub async fn submitted(network: &Network, node: &SigningNode, claim: Claim, won: &str) -> Outcome {
    match node.submit(network, claim, &real_proof().1).await {
        Ok(SubmitReply { accepted: true, .. }) => Outcome::Succeeded(won.into()),
        Ok(reply) => Outcome::Refused(reason(&reply)),
        Err(status) => Outcome::Refused(status.message().into()),
    }
}
