//! A node registers its recording again before its secret is worn out. It may be killed at any point of that, and it stops where the secret is lost.

use ed25519_dalek::SigningKey;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use zk0_aggregator::Config;
use zk0_argument::claim::most_uses;
use zk0_circuits::Digest;
use zk0_node::client::NodeClient;
use zk0_node::error::ParticipantError;
use zk0_node::recording::evaluation_set::EvaluationSet;
use zk0_node::recording::recompute::{recompute, Recomputed};
use zk0_node::recording::registering::Registering;
use zk0_node::recording::secret::{count, RegistrationSecret, Secrets};
use zk0_node::recording::OpenRecording;
use zk0_node::turn::unfinished::{RoundParticipation, UnfinishedUpdate};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_testkit::aggregator;
use zk0_testkit::aggregator::Network;
use zk0_testkit::micro_network::{pickplace, Setting};

/// A network without rounds, and a node of it.
struct Scene {
    network: Network,
    key: SigningKey,
    setting: Setting,
    state: TempDir,
}

impl Scene {
    async fn new() -> Self {
        let node = aggregator::SigningNode::new(1);
        let config = Config {
            rounds: Some(0),
            min_nodes: 1,
        };
        Self {
            network: Network::start(&[&node], config).await,
            key: node.key,
            setting: Setting::new(),
            state: tempfile::tempdir().unwrap(),
        }
    }

    /// Does what a node does that has just started, with this recording.
    async fn started<T>(
        &self,
        recording: &Path,
        run: impl AsyncFnOnce(&Registering<'_>, &mut NodeClient) -> T,
    ) -> T {
        let id = self.network.genesis.network_id();
        let node = NodeClient::connect(self.network.address.clone(), id, self.key.clone());
        let clock = self.network.clock.clone();
        let mut node = node.await.unwrap().by_clock(move || {
            use zk0_aggregator::Clock;
            clock.now_ms()
        });
        let recording = OpenRecording::open(recording, &self.setting.policy(), None).unwrap();
        let maker = recording.maker();
        let samples = recording.samples(&maker);
        let registering = Registering {
            state: self.state.path(),
            recording: &recording,
            samples: &samples,
            spec: &self.setting.spec,
        };
        run(&registering, &mut node).await
    }

    /// The evaluation set that a node has when it has started.
    async fn enters(&self) -> Result<EvaluationSet, ParticipantError> {
        self.started(&pickplace(), async |node, to| node.enter(to).await)
            .await
    }

    async fn again(&self, present: &EvaluationSet) {
        self.started(&pickplace(), async |node, to| node.again(to, present).await)
            .await
            .unwrap();
    }

    async fn of_round(&self, round: u64, present: &EvaluationSet) -> Option<Digest> {
        let other = self
            .started(&pickplace(), async |node, to| {
                node.of_round(to, round, present).await
            })
            .await;
        other.unwrap().map(|set| set.commitment.root)
    }

    /// The node has begun this round with this set.
    fn begun(&self, round: u64, with: &EvaluationSet) {
        let part = RoundParticipation {
            network: self.network.genesis.network_id(),
            round,
            base: Digest([1; 32]),
            dataset: with.commitment.root,
        };
        let kept = UnfinishedUpdate {
            of: part,
            eval_samples: 4,
            file: vec![7; 1000],
        };
        kept.keep(self.state.path()).unwrap();
    }

    /// Makes so many arguments about the first sample.
    fn argues(&self, set: &EvaluationSet, arguments: u32) {
        for _ in 0..arguments {
            let most = most_uses(&self.setting.spec);
            count(self.state.path(), set.secret(), &[0], most).unwrap();
        }
    }

    /// How many arguments wear a secret.
    fn worn(&self) -> u32 {
        (4 * most_uses(&self.setting.spec)).div_ceil(5)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.state.path().join(name)
    }

    fn secrets(&self) -> Secrets {
        Secrets::of_registered(self.state.path()).unwrap()
    }

    async fn registrations(&self) -> Vec<DatasetRegistration> {
        let entries = self.network.entries().await.into_iter();
        let registered = entries.filter_map(|entry| match entry.body {
            Body::DatasetCommitted(signed) => Some(signed.statement),
            _ => None,
        });
        registered.collect()
    }

    async fn roots(&self) -> Vec<Digest> {
        let registered = self.registrations().await.into_iter();
        registered.map(|one| one.dataset.root).collect()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worn_secret_is_replaced_and_begun_rounds_end_with_the_old_one() {
    let scene = Scene::new().await;
    let first = scene.enters().await.unwrap();
    scene.argues(&first, scene.worn() - 1);
    scene.again(&first).await;
    assert_eq!(scene.roots().await, [first.commitment.root]);
    assert_eq!(scene.of_round(0, &first).await, None);

    scene.argues(&first, 1);
    scene.begun(0, &first);
    scene.again(&first).await;
    let roots = scene.roots().await;
    let [_, second] = roots[..] else {
        panic!("{roots:?}");
    };
    assert_ne!(second, first.commitment.root);
    // It is registered once, however often the node looks, and the fresh secret is not worn.
    scene.again(&first).await;
    let again = scene.enters().await.unwrap();
    assert_eq!(again.commitment.root, second);
    scene.again(&again).await;
    assert_eq!(scene.roots().await, roots);

    // A node that goes on, and one that was started again, end what they have begun, and go on with the fresh secret.
    assert_eq!(scene.of_round(0, &first).await, None);
    assert_eq!(scene.of_round(1, &first).await, Some(second));
    assert_eq!(scene.of_round(0, &again).await, Some(first.commitment.root));
    assert_eq!(scene.of_round(1, &again).await, None);
}

/// Same frames, other leaves; and the auditor finds both registrations right.
#[tokio::test(flavor = "multi_thread")]
async fn registering_again_gives_other_leaves_of_the_same_frames() {
    let scene = Scene::new().await;
    let first = scene.enters().await.unwrap();
    scene.argues(&first, scene.worn());
    scene.again(&first).await;
    let second = scene.enters().await.unwrap();
    assert_eq!(second.drawn_names, first.drawn_names);
    let registered = scene.registrations().await;
    assert_eq!(registered[0].episodes, registered[1].episodes);
    let id = registered[0].node;
    let lists = [&first, &second].map(|set| {
        let (registration, list) = set.registration(id);
        registration.read_list(&list).unwrap()
    });
    for (one, other) in lists[0].iter().zip(&lists[1]) {
        assert_eq!(one.frame, other.frame);
        assert_ne!(one.leaf, other.leaf);
    }
    let secrets = scene.secrets();
    let audited = async |node: &Registering<'_>, _: &mut NodeClient| {
        [0, 1].map(|at| {
            let (recording, samples) = (node.recording, node.samples);
            let evaluated = (scene.setting.mode, node.spec);
            let (registration, list) = (&registered[at], &lists[at]);
            recompute(recording, samples, evaluated, registration, list, &secrets).unwrap()
        })
    };
    let same = Recomputed::Same { frames: 10 };
    let found = scene.started(&pickplace(), audited).await;
    assert_eq!(found, [same.clone(), same]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_was_killed_before_the_ledger_had_the_new_dataset_registers_it() {
    let scene = Scene::new().await;
    let first = scene.enters().await.unwrap();
    scene.begun(0, &first);
    let mut secrets = scene.secrets();
    secrets.add(RegistrationSecret::new([8; 32]));
    secrets.keep(scene.state.path()).unwrap();

    let second = scene.enters().await.unwrap();
    let (old, new) = (first.commitment.root, second.commitment.root);
    assert_eq!(scene.roots().await, [old, new]);
    assert!(*second.secret() == RegistrationSecret::new([8; 32]));
    assert_eq!(scene.of_round(0, &second).await, Some(old));
    assert_eq!(scene.of_round(1, &first).await, Some(new));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_was_killed_when_the_ledger_had_the_new_dataset_goes_on_with_it() {
    let scene = Scene::new().await;
    let first = scene.enters().await.unwrap();
    let kept = fs::read(scene.file("registration")).unwrap();
    scene.argues(&first, scene.worn());
    scene.again(&first).await;
    let roots = scene.roots().await;
    // It had no time to write what it has registered.
    fs::write(scene.file("registration"), kept).unwrap();
    let second = scene.enters().await.unwrap();
    assert_eq!(roots, [first.commitment.root, second.commitment.root]);
    assert_eq!(scene.roots().await, roots);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_whose_secret_is_lost_stops_and_says_how_to_register_again() {
    let scene = Scene::new().await;
    let first = scene.enters().await.unwrap();
    let (secret, registration) = (scene.file("secret"), scene.file("registration"));
    let good = fs::read(&secret).unwrap();
    let mut other = Secrets::default();
    other.add(RegistrationSecret::new([8; 32]));
    for (bytes, why) in [
        (Some(good[..good.len() - 1].to_vec()), "is damaged"),
        (
            Some(other.encode()),
            "does not have the secret of the registered dataset",
        ),
        (None, "is not there any more"),
    ] {
        match &bytes {
            Some(bytes) => fs::write(&secret, bytes).unwrap(),
            None => fs::remove_file(&secret).unwrap(),
        }
        let reported = scene.enters().await.err().unwrap().to_string();
        let step = format!(
            "move the files `secret` and `registration` out of {}, and start the node again",
            scene.state.path().display()
        );
        assert!(
            reported.contains(why) && reported.contains(&step),
            "{reported}"
        );
        assert_eq!(fs::read(&secret).ok(), bytes, "it was overwritten");
    }
    assert_eq!(scene.roots().await, [first.commitment.root]);
    // A damaged file stops the node even where nothing else states that it has registered.
    fs::remove_file(&registration).unwrap();
    fs::write(&secret, &good[1..]).unwrap();
    let reported = scene.enters().await.err().unwrap().to_string();
    assert!(reported.contains("is damaged"), "{reported}");
    // The operator does what the error states.
    fs::remove_file(&secret).unwrap();
    let second = scene.enters().await.unwrap();
    let roots = [first.commitment.root, second.commitment.root];
    assert_ne!(roots[0], roots[1]);
    assert_eq!(scene.roots().await, roots);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_secret_is_of_one_recording_and_an_interrupted_node_keeps_it() {
    let scene = Scene::new().await;
    // It was interrupted before it could register.
    let mut secrets = Secrets::default();
    secrets.add(RegistrationSecret::new([8; 32]));
    secrets.keep(scene.state.path()).unwrap();
    let first = scene.enters().await.unwrap();
    assert!(*first.secret() == RegistrationSecret::new([8; 32]));
    let other = pickplace().with_file_name("so100_stacking");
    let second = scene
        .started(&other, async |node, to| node.enter(to).await)
        .await
        .unwrap();
    assert!(first.secret() != second.secret());
    // The first recording is not the one that was registered last, so it gets a fresh secret, too.
    let third = scene.enters().await.unwrap();
    assert!(third.secret() != first.secret() && third.secret() != second.secret());
    // A secret under which arguments were made is not taken for one of an interrupted node.
    scene.argues(&third, 1);
    fs::remove_file(scene.file("registration")).unwrap();
    let fourth = scene.enters().await.unwrap();
    assert!(fourth.secret() != third.secret());
}
