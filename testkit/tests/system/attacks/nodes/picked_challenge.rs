//! Row 1. A node waits until the randomness of a round is known. Then it computes the challenge of each update that it could commit to, and
//! commits to the one whose samples suit it.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_protocol::challenge::closing::commitment;
use zk0_protocol::entries::entry::Body;
use zk0_testkit::aggregator::{committed, digest, open_round, weights};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 1,
    name: "a node commits when it knows the randomness, to the update with the easiest samples",
    module: module_path!(),
    reason: "the commitments of round 0 are closed",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "nobody commits after the commitments closed, or after their deadline",
        out: &[SourceChange {
            file: "protocol/src/rules/apply/rounds.rs",
            replacements: &[
                (
                    "if round.closing.is_some() {",
                    "if round.closing.is_some() && !OUT {",
                ),
                (
                    "            time_ms,
            round.opened.commit_deadline_ms,
",
                    "            if OUT { 0 } else { time_ms },
            round.opened.commit_deadline_ms,
",
                ),
            ],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

/// The candidates: as many updates as a node may upload.
const SEEDS: [u32; 4] = [11, 12, 13, 14];
/// The sample that the node knows to be easy.
const EASY: u64 = 7;

async fn carry_out() -> Outcome {
    let (network, honest, cheat) = open_round().await;
    for seed in SEEDS {
        cheat.upload(&network, 0, &weights(seed)).await.unwrap();
    }
    committed(&network, &honest, 0, 1).await;
    network.drawn().await;
    let round = network.round(Some(0)).await;
    let (_, _, entry) = network.opened(round.randomness.unwrap());
    let Body::RandomnessDrawn(drawn) = entry.body else {
        panic!("{entry:?}");
    };
    let (id, randomness) = (network.genesis.network_id(), drawn.drawing.value().unwrap());
    // The place of the easy sample among those that the challenge of an update draws: the lower the better.
    let rank = |seed: &u32| {
        let statement = cheat.commitment(&id, 0, &weights(*seed));
        let challenge = challenge(&id, 0, &cheat.id(), &commitment(&statement), &randomness);
        let drawn = sample_indices(&challenge, cheat.dataset().samples, 10).unwrap();
        drawn.iter().position(|index| *index == EASY)
    };
    let best = *SEEDS.iter().min_by_key(|seed| rank(seed)).unwrap();
    let receipt = cheat.commit(&network, 0, &weights(best)).await;
    answered(receipt, |_| {
        let update = digest(&weights(best)).blob;
        format!("the ledger has its commitment to {update}, whose challenge it compared with those of {} others", SEEDS.len() - 1)
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
