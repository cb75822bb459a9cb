//! One round of many nodes. They submit a real proof that is of another claim: SP1's verifier verifies it in full, and then it is rejected,
//! which the ledger records. To prove a claim of its own for each node would take days.

use crate::figures::{figure, peak_memory};
use crate::nodes::all_ask;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;
use zk0_aggregator::{Config, Limits};
use zk0_circuits::{Claim, Mode};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::real_proof::real_proof;
use zk0_testkit::aggregator::{genesis, reason, weights, Network, SigningNode};
use zk0_verifier::releases::check_proof_of;

/// How many proofs are verified for the peer's figure.
const PROOFS: usize = 40;

pub async fn measure(count: u16) {
    let (program, proof) = real_proof();
    let proof = Arc::new(proof);
    let nodes: Vec<_> = (1..=count)
        .map(|seed| Arc::new(SigningNode::numbered(seed)))
        .collect();
    let mut genesis = Genesis {
        program: program.key.clone(),
        mode: Mode::Direct,
        ..genesis()
    };
    genesis.rules.max_proof_bytes = 4 << 20;
    let config = Config {
        rounds: Some(1),
        min_nodes: count.into(),
    };
    eprintln!("enrols {count} nodes …");
    let started = Instant::now();
    let of: Vec<&SigningNode> = nodes.iter().map(|node| &**node).collect();
    let network = Network::start_as(&of, config, Limits::default(), genesis, None, None).await;
    let network = Arc::new(network);
    eprintln!("{:.1} s", started.elapsed().as_secs_f64());

    let registered = all_ask(&network, &nodes, |_, network, node| async move {
        node.register(&network).await
    })
    .await;
    reported(
        "register_datasets",
        &registered.seconds,
        registered.repeated,
    );
    network.settle().await;
    let uploaded = all_ask(&network, &nodes, |number, network, node| async move {
        node.upload(&network, 0, &weights(number as u32 + 1)).await
    })
    .await;
    reported("upload_updates", &uploaded.seconds, uploaded.repeated);
    let committed = all_ask(&network, &nodes, |number, network, node| async move {
        node.commit(&network, 0, &weights(number as u32 + 1)).await
    })
    .await;
    reported("commit", &committed.seconds, committed.repeated);

    network.drawn().await;
    let claims = Arc::new(claims(&network, &nodes).await);
    let submitted = {
        let (claims, proof) = (claims.clone(), proof.clone());
        all_ask(&network, &nodes, move |number, network, node| {
            let (claim, proof) = (claims[number].clone(), proof.clone());
            async move { node.submit(&network, claim, &proof).await }
        })
        .await
    };
    let closing = Instant::now();
    while network.round(Some(0)).await.closed.is_none() {
        network.settle().await;
    }
    let closing = closing.elapsed().as_secs_f64();
    let alone = verifying_alone(&program, &proof, &claims[0]) * f64::from(count);
    figure("submit", submitted.seconds, Some(alone), "s");
    eprintln!("{} requests were repeated", submitted.repeated);
    figure("from_last_submission_to_close", closing, None, "s");

    let receipts =
        (registered.all.into_iter())
            .chain(committed.all)
            .chain(submitted.all.into_iter().map(|reply| {
                assert_eq!(reason(&reply), RefusalCode::OtherClaim.to_string());
                reply.receipt.expect("a decision has a receipt")
            }));
    let mut verified = 0;
    let mut decided = BTreeSet::new();
    for receipt in receipts {
        let (_, _, entry) = network.opened(receipt);
        verified += 1;
        if let Body::ContributionRejected { submission, .. } = entry.body {
            decided.insert(submission.statement.claim.terms.node);
        }
    }
    assert_eq!(decided.len(), nodes.len(), "a submission is lost");
    eprintln!("verified all {verified} receipts; none of {count} submissions is lost");
    figure("peak_memory_of_all", peak_memory(), None, "MiB");
}

fn reported(bench: &str, seconds: &f64, repeated: usize) {
    figure(bench, *seconds, None, "s");
    eprintln!("{repeated} requests were repeated");
}

/// The claim that the ledger expects of each node.
async fn claims(network: &Network, nodes: &[Arc<SigningNode>]) -> Vec<Claim> {
    let ids: Vec<_> = nodes.iter().map(|node| node.id()).collect();
    let expected = move |aggregator: &mut zk0_aggregator::Aggregator| {
        let state = aggregator.state();
        Ok(ids
            .iter()
            .map(|id| state.expected_claim(id))
            .collect::<Result<Vec<_>, _>>()?)
    };
    let expected = network.service().with(expected).await.expect("committed");
    let pairs = nodes.iter().zip(expected);
    pairs.map(|(node, claim)| node.claim_of(claim)).collect()
}

/// Seconds for one proof, where SP1's verifier has all cores to itself.
fn verifying_alone(program: &Program, proof: &[u8], claim: &Claim) -> f64 {
    let started = Instant::now();
    let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                for _ in 0..PROOFS / cores {
                    let refused = check_proof_of(program, proof, claim);
                    assert_eq!(refused, Err(RefusalCode::OtherClaim.into()));
                }
            });
        }
    });
    started.elapsed().as_secs_f64() / (PROOFS / cores * cores) as f64
}
