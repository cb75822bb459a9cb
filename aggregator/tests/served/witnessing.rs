//! The aggregator publishes nothing before a quorum of witnesses has cosigned it. Entries are safe on disk even without the
//! witnesses.

use ed25519_dalek::SigningKey;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::task::spawn_blocking;
use tonic::Code;
use zk0_aggregator::publish::cosigning::{ConsistencyProver, CosigningError, Witnesses};
use zk0_aggregator::{Aggregator, Config, Limits, Service};
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::folder;
use zk0_ledger::published::publication::{Publication, PublicationError};
use zk0_ledger::published::reader::PublishedLog;
use zk0_ledger::witness_store::hash;
use zk0_ledger::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{Checkpoint, WitnessPolicy};
use zk0_testkit::aggregator::witnesses::{cosigned, enrol, ledger, log_verifier, three, DEADLINE};
use zk0_testkit::aggregator::*;
use zk0_testkit::network::log_keys::later_key;
use zk0_testkit::until_async;

fn published(dir: &Path) -> u64 {
    Publication::open(dir, None).unwrap().checkpoint().size
}

#[tokio::test(flavor = "multi_thread")]
async fn receipts_wait_for_the_quorum_and_entries_do_not() {
    let (mut witnesses, policy) = three().await;
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 4,
    };
    let mut network = Network::start(&[&first, &second], config).await;
    let dir = network.dir.path().to_owned();
    network.policy = Some(policy.clone());
    network.restart().await;
    // At first all three witnesses run, then one is stopped. Receipts still come, and their entries are published by then.
    let receipt = first.register(&network).await.unwrap();
    assert!(published(&dir) > receipt.index);
    witnesses[0].off().await;
    registered(&network, &second, &dir).await;
    let view = Publication::open(&dir, None).unwrap();
    let log_at = PublishedLog::open(&view, &log_verifier(), &policy).unwrap();
    let proof = log_at.prove(2).unwrap();
    let (witnessed, _) = proof.verify(&log_verifier(), &policy).unwrap();
    assert_eq!(witnessed.cosigners.len(), 2);
    // With two witnesses stopped, the entry is on disk, but the receipt and the checkpoint are not published.
    witnesses[1].off().await;
    let before = (published(&dir), fs::read(dir.join("cosigned")).unwrap());
    let third = SigningNode::new(3);
    let (id, name) = (third.id(), "late".to_owned());
    network
        .service()
        .with(move |aggregator| aggregator.enrol(id, name))
        .await
        .unwrap();
    refused(
        third.register(&network).await,
        Code::Unavailable,
        "too few witnesses",
    );
    let entries = network.entries().await;
    assert!(matches!(
        entries.last().unwrap().body,
        Body::DatasetCommitted(_)
    ));
    assert_eq!(
        before,
        (published(&dir), fs::read(dir.join("cosigned")).unwrap())
    );
    assert!(entries.len() as u64 > before.0);
    // No other answer shows more than what is published.
    let request = zk0_protocol::rpc::federation::GetNetworkRequest {};
    let info = network
        .client()
        .await
        .get_network(request)
        .await
        .unwrap()
        .into_inner();
    assert_eq!(
        info.checkpoint.lines().nth(1),
        Some(before.0.to_string().as_str())
    );
    // The aggregator is killed and starts again without the witnesses. Still nothing new is published.
    network.restart().await;
    refused(
        third.register(&network).await,
        Code::Unavailable,
        "too few witnesses",
    );
    assert_eq!(before.0, published(&dir));
    // One witness comes back. The same request now gets the receipt of the same entry.
    witnesses[1].on().await;
    let receipt = third.register(&network).await.unwrap();
    assert_eq!(receipt.index, entries.len() as u64 - 1);
    assert!(published(&dir) > receipt.index);
}

/// Registers a node's dataset, and checks that the entry is published when the receipt comes.
async fn registered(network: &Network, node: &SigningNode, dir: &Path) {
    let receipt = node.register(network).await.unwrap();
    assert!(published(dir) > receipt.index);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_that_is_not_published_is_not_shown() {
    let (mut witnesses, policy) = three().await;
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let mut network = Network::start(&[&first, &second], config).await;
    network.policy = Some(policy);
    network.restart().await;
    first.register(&network).await.unwrap();
    witnesses[0].off().await;
    witnesses[1].off().await;
    refused(
        second.register(&network).await,
        Code::Unavailable,
        "too few witnesses",
    );
    network.settle().await;
    assert!(matches!(network.last().await, Body::RoundOpened(_)));
    assert_eq!(network.round(None).await.opened, None);
    assert_eq!(network.round(Some(0)).await.opened, None);
    witnesses[0].on().await;
    second.register(&network).await.unwrap();
    // The newest checkpoint is cosigned soon, even if nobody asks for it.
    let published = async || network.round(None).await.opened;
    until_async("the round is published", published).await;
    committed(&network, &first, 0, 1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_published_before_the_first_quorum() {
    let (mut witnesses, policy) = three().await;
    for witness in &mut witnesses {
        witness.off().await;
    }
    let first = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let mut network = Network::start(&[&first], config).await;
    network.policy = Some(policy);
    network.restart().await;
    let opened = Publication::open(network.dir.path(), None).map(drop);
    assert!(matches!(opened, Err(PublicationError::NotCosigned(_))));
    // Who connects learns no more than which network it is.
    let request = zk0_protocol::rpc::federation::GetNetworkRequest {};
    let info = network.client().await.get_network(request).await;
    let checkpoint = info.unwrap().into_inner().checkpoint;
    assert_eq!(checkpoint.lines().nth(1), Some("1"));
    let round = zk0_protocol::rpc::federation::GetRoundRequest::default();
    let round = network.client().await.get_round(round).await;
    refused(round, Code::Unavailable, "nothing is published");
}

fn why(error: CosigningError) -> String {
    match error {
        CosigningError::NoQuorum { refused, .. } => refused.join("; "),
        other => panic!("{other}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_forked_or_rolled_back_log_gets_no_quorum() {
    let (mut witnesses, policy) = three().await;
    let dirs: Vec<_> = (0..4).map(|_| tempfile::tempdir().unwrap()).collect();
    let honest = Arc::new(ledger(dirs[0].path(), &[1, 2, 3, 4]));
    let note = cosigned(&policy, &honest).await.unwrap();
    policy.open(&note, &log_verifier()).unwrap();
    // One fork has the same size and another entry. Another fork has more entries on top of that. The second pass tries both after
    // all witnesses were restarted.
    let forked = Arc::new(ledger(dirs[1].path(), &[1, 2, 9, 4]));
    let longer = Arc::new(ledger(dirs[2].path(), &[1, 2, 9, 4, 5, 6]));
    let shorter = Arc::new(ledger(dirs[3].path(), &[1, 2]));
    for _ in 0..2 {
        for (fork, status) in [(&forked, "status 409"), (&longer, "status 422")] {
            let why = why(cosigned(&policy, fork).await.unwrap_err());
            assert!(why.contains(status), "{why}");
        }
        // The witnesses have seen more than this shorter log holds.
        let why = why(cosigned(&policy, &shorter).await.unwrap_err());
        assert!(why.contains("rolled back"), "{why}");
        for witness in &mut witnesses {
            witness.off().await;
            witness.on().await;
        }
    }
    // The honest log goes on.
    let Ok(mut honest) = Arc::try_unwrap(honest) else {
        panic!("still in use");
    };
    enrol(&mut honest, 5);
    let note = cosigned(&policy, &Arc::new(honest)).await.unwrap();
    assert_eq!(
        policy.open(&note, &log_verifier()).unwrap().checkpoint.size,
        6
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_that_answers_nonsense_or_not_at_all_costs_no_more_than_the_deadline() {
    let (mut witnesses, _) = three().await;
    let dir = tempfile::tempdir().unwrap();
    let ledger = Arc::new(ledger(dir.path(), &[1]));
    // W0 accepts connections and states nothing. W1 signs with another key than the policy names.
    witnesses[0].off().await;
    let mute = TcpListener::bind(&witnesses[0].address).await.unwrap();
    let stranger = SigningKey::from_bytes(&[77; 32]);
    let stranger = Cosigner::new("witness.example/w1", stranger).unwrap();
    let lines = format!(
        "{}witness W1 {} http://{}\n{}",
        witnesses[0].line(),
        stranger.key(),
        witnesses[1].address,
        witnesses[2].line()
    );
    let two = WitnessPolicy::parse(&format!("{lines}group g 2 W0 W1 W2\nquorum g\n")).unwrap();
    let begun = std::time::Instant::now();
    let why = why(cosigned(&two, &ledger).await.unwrap_err());
    assert!(why.contains("without a valid cosignature"), "{why}");
    assert!(begun.elapsed() < 3 * DEADLINE, "{:?}", begun.elapsed());
    // If one witness is enough, the aggregator does not wait for the silent one.
    let one = WitnessPolicy::parse(&format!("{lines}group g any W0 W1 W2\nquorum g\n")).unwrap();
    let begun = std::time::Instant::now();
    cosigned(&one, &ledger).await.unwrap();
    assert!(begun.elapsed() < DEADLINE / 2, "{:?}", begun.elapsed());
    drop(mute);
    let nowhere = WitnessPolicy::parse(&format!("witness W {}\nquorum W\n", stranger.key()));
    let error = cosigned(&nowhere.unwrap(), &ledger).await.unwrap_err();
    assert!(matches!(error, CosigningError::NoAddress(_)));
}

/// Proves that the ledger continues its earlier checkpoints.
fn prover(ledger: &Ledger) -> ConsistencyProver {
    let reader = ledger.reader().clone();
    Arc::new(move |old, new| {
        let proof = reader.consistency_between(old, new);
        proof.map_err(|error| error.to_string())
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_tells_an_older_ledger_and_another_one_from_the_newest() {
    let (mut witnesses, policy) = three().await;
    let dirs: Vec<_> = (0..5).map(|_| tempfile::tempdir().unwrap()).collect();
    let logs = [&[1, 2][..], &[1, 2, 3], &[1], &[1, 9], &[1, 9, 4]];
    let logs = logs.iter().zip(&dirs);
    let logs: Vec<_> = logs.map(|(nodes, dir)| ledger(dir.path(), nodes)).collect();
    let [newest, longer, older, forked, longer_fork] = <[_; 5]>::try_from(logs).ok().unwrap();
    let check = async |ledger: &Ledger| {
        let (checkpoint, prove) = (ledger.checkpoint().to_vec(), prover(ledger));
        let policy = policy.clone();
        let checked = spawn_blocking(move || {
            let witnesses = Witnesses::new(policy, DEADLINE).unwrap();
            let known = witnesses.continues(&checkpoint, &prove);
            known.map_err(|error| error.to_string())
        });
        checked.await.unwrap()
    };
    assert_eq!(check(&newest).await, Ok(3));
    for (wrong, why) in [
        (&older, "rolled back"),
        (&forked, "status 409"),
        (&longer_fork, "status 422"),
    ] {
        let error = check(wrong).await.unwrap_err();
        assert!(error.contains(why), "{error}");
    }
    assert_eq!(check(&newest).await, Ok(3));
    assert_eq!(check(&longer).await, Ok(3));
    witnesses[0].off().await;
    assert_eq!(check(&longer).await, Ok(2));
    for witness in &mut witnesses[1..] {
        witness.off().await;
    }
    assert_eq!(check(&longer).await, Ok(0));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_of_a_fork_is_ignored_only_if_the_others_are_a_quorum() {
    let (witnesses, policy) = three().await;
    let dirs = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let fork = Arc::new(ledger(dirs[0].path(), &[1, 9]));
    let alone = WitnessPolicy::parse(&format!("{}quorum W2\n", witnesses[2].line())).unwrap();
    cosigned(&alone, &fork).await.unwrap();
    let honest = ledger(dirs[1].path(), &[1, 2]);
    let (checkpoint, prove) = (honest.checkpoint().to_vec(), prover(&honest));

    let ignoring = |names: &[&str], is_newest: bool| {
        let names: Vec<_> = names.iter().map(|name| (*name).to_owned()).collect();
        let all = Witnesses::new(policy.clone(), DEADLINE).unwrap();
        let others = all.ignoring(&names, is_newest);
        others.map_err(|error| error.to_string())
    };
    let refused = |names: &[&str]| ignoring(names, false).err().unwrap();
    let unknown = refused(&["W2", "W9"]);
    assert!(unknown.contains("ignore-witness W9: "), "{unknown}");
    assert!(unknown.contains(" W0, W1, W2: "), "{unknown}");
    let most = refused(&["W1", "W2"]);
    assert!(most.contains("no quorum") && most.contains("--newest-checkpoint"));
    let all = ignoring(&[], false).unwrap();
    let two = ignoring(&["W2"], false).unwrap();
    let one = ignoring(&["W1", "W2"], true).unwrap();
    let compared = spawn_blocking(move || {
        let error = all.continues(&checkpoint, &prove).unwrap_err().to_string();
        assert!(error.starts_with("witness W2 refuses"), "{error}");
        let (name, _) = all.contradiction().unwrap();
        assert_eq!(name, "W2");
        assert_eq!(one.continues(&checkpoint, &prove).unwrap(), 1);
        assert_eq!(two.continues(&checkpoint, &prove).unwrap(), 2);
        // It is asked for a cosignature all the same.
        two.cosign_all(&checkpoint, &prove).unwrap_err();
        assert!(two.states()[2].outage.as_ref().unwrap().contradicts);
        assert_eq!(two.contradiction(), None);
    });
    compared.await.unwrap();
}

/// Randomness of witnesses asks for the cosignature of an earlier checkpoint.
#[tokio::test(flavor = "multi_thread")]
async fn a_witness_that_has_cosigned_does_not_contradict_an_earlier_checkpoint() {
    let (_witnesses, policy) = three().await;
    let dirs = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let earlier = ledger(dirs[0].path(), &[1]).checkpoint().to_vec();
    let newest = ledger(dirs[1].path(), &[1, 2]);
    let (checkpoint, prove) = (newest.checkpoint().to_vec(), prover(&newest));
    let asked = spawn_blocking(move || {
        let witnesses = Witnesses::new(policy.clone(), DEADLINE).unwrap();
        witnesses.cosign_all(&checkpoint, &prove).unwrap();
        witnesses.cosign_all(&earlier, &prove).unwrap_err();
        assert_eq!(witnesses.contradiction(), None);
        // A process that has begun since then cannot know whether they are right.
        let others = Witnesses::new(policy, DEADLINE).unwrap();
        others.cosign_all(&earlier, &prove).unwrap_err();
        assert!(others.contradiction().is_some());
    });
    asked.await.unwrap();
}

/// Speaks to the witness over HTTP as any client of the specification does.
#[tokio::test(flavor = "multi_thread")]
async fn a_witness_speaks_the_protocol() {
    let (witnesses, policy) = three().await;
    let dir = tempfile::tempdir().unwrap();
    let honest = Arc::new(ledger(dir.path(), &[1, 2, 3]));
    cosigned(&policy, &honest).await.unwrap();
    let base = format!("http://{}", witnesses[1].address);
    // Nobody may have waited for W1 before, so this request asks W1 alone.
    let alone = WitnessPolicy::parse(&format!("{}quorum W1\n", witnesses[1].line())).unwrap();
    cosigned(&alone, &honest).await.unwrap();
    let checkpoint = honest.checkpoint().to_vec();
    tokio::task::spawn_blocking(move || {
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .build()
            .into();
        let post = |body: &[u8]| {
            agent
                .post(format!("{base}/add-checkpoint"))
                .send(body)
                .unwrap()
        };
        let mut conflict = post(&[b"old 0\n\n", &checkpoint[..]].concat());
        assert_eq!(conflict.status(), 409);
        assert_eq!(conflict.headers()["content-type"], "text/x.tlog.size");
        assert_eq!(conflict.body_mut().read_to_string().unwrap(), "4\n");
        let mut again = post(&[b"old 4\n\n", &checkpoint[..]].concat());
        assert_eq!(again.status(), 200);
        let line = again.body_mut().read_to_string().unwrap();
        assert!(
            line.starts_with("— witness.example/w1 ") && line.ends_with('\n'),
            "{line}"
        );
        assert_eq!(post(b"old 5\n\n").status(), 400);
        assert_eq!(
            post(&[b"old 5\n\n", &checkpoint[..]].concat()).status(),
            400
        );
        assert_eq!(post(&vec![b'x'; 100_000]).status(), 413);
        let get = |path: String| agent.get(format!("{base}/{path}")).call().unwrap();
        let mut last = get(format!("{}/checkpoint", hash(&genesis().name)));
        assert_eq!(last.status(), 200);
        let note = last.body_mut().read_to_vec().unwrap();
        assert_eq!(
            alone.open(&note, &log_verifier()).unwrap().checkpoint.size,
            4
        );
        assert_eq!(get(format!("{}/checkpoint", hash("another"))).status(), 404);
        assert_eq!(get("add-checkpoint".into()).status(), 405);
        assert_eq!(get("lock".into()).status(), 404);
    })
    .await
    .unwrap();
}

/// Nobody sees the round, so nobody could commit in time.
#[tokio::test(flavor = "multi_thread")]
async fn no_window_ends_while_its_beginning_is_not_published() {
    let (mut witnesses, policy) = three().await;
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let mut network = Network::start(&[&first, &second], config).await;
    network.policy = Some(policy);
    network.restart().await;
    first.register(&network).await.unwrap();
    witnesses[0].off().await;
    witnesses[1].off().await;
    refused(
        second.register(&network).await,
        Code::Unavailable,
        "too few witnesses",
    );
    network.settle().await;
    assert!(matches!(network.last().await, Body::RoundOpened(_)));
    network.clock.advance(COMMIT_MS + 1);
    network.settle().await;
    assert!(matches!(network.last().await, Body::RoundOpened(_)));
    witnesses[0].on().await;
    let moved = async || match network.last().await {
        Body::DeadlinesMoved(moved) => Some(moved),
        _ => None,
    };
    let moved = until_async("the deadline moves", moved).await;
    assert!(moved.by_ms > COMMIT_MS, "{moved:?}");
    let published = async || network.round(None).await.opened;
    until_async("the round is published", published).await;
    committed(&network, &first, 0, 1).await;
}

/// A witness may have cosigned what a thief of the former key has signed.
#[tokio::test(flavor = "multi_thread")]
async fn a_cosigned_checkpoint_of_a_former_key_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    drop(found(dir.path(), genesis(), clock.clone(), config).unwrap());
    let (later, blobs) = (later_key(1), Blobs::at(dir.path()));
    let opened = Ledger::open_to_rotate(dir.path(), None, later.clone(), None, blobs, &mut ());
    opened.unwrap().rotate_key(&log_key(), START_MS).unwrap();
    let cosigner = SigningKey::from_bytes(&[77; 32]);
    let cosigner = Cosigner::new("witness.example/w", cosigner).unwrap();
    let policy = format!(
        "witness W {} http://127.0.0.1:1\nquorum W\n",
        cosigner.key()
    );
    let policy = WitnessPolicy::parse(&policy).unwrap();
    let larger = Checkpoint {
        size: 99,
        root: Digest([7; 32]),
    };
    let signed = larger.sign(&genesis().name, &log_key()).unwrap();
    let cosignature = cosigner.cosign(&larger.text(&genesis().name).unwrap(), 1);
    folder::write_cosigned(dir.path(), &[signed, cosignature].concat()).unwrap();
    let aggregator = Aggregator::open(dir.path(), None, later, clock, config).unwrap();
    let service = Service::with_limits(aggregator, Limits::default());
    let witnesses = Arc::new(Witnesses::new(policy, DEADLINE).unwrap());
    let refused = service.witnessed(witnesses).await.err().unwrap();
    let words = "a former key of the log has signed it";
    assert!(refused.to_string().contains(words), "{refused}");
}
