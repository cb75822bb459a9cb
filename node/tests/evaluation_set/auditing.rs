//! An auditor who has the recording and the node's secret finds out whether the registered samples are those of the recording.

use std::path::Path;
use zk0_circuits::Digest;
use zk0_node::recording::recompute::{recompute, Recomputed};
use zk0_node::recording::secret::{RegistrationSecret, Secrets};
use zk0_node::recording::OpenRecording;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::evaluation_set::DrawnLeaf;
use zk0_testkit::made_recording::{make, MadeEpisode};
use zk0_testkit::micro_network::{pickplace, Setting, SECRET};

struct Audited {
    setting: Setting,
    registration: DatasetRegistration,
    list: Vec<DrawnLeaf>,
}

impl Audited {
    fn new() -> Self {
        let setting = Setting::new();
        let (registration, list) = setting.registered(&pickplace(), None, 40);
        let list = registration.read_list(&list).unwrap();
        Self {
            setting,
            registration,
            list,
        }
    }

    fn with(&self, recording: &Path, secret: RegistrationSecret) -> Recomputed {
        let mut secrets = Secrets::default();
        secrets.add(secret);
        self.with_all(recording, &secrets)
    }

    fn with_all(&self, recording: &Path, secrets: &Secrets) -> Recomputed {
        let recording = OpenRecording::open(recording, &self.setting.policy(), None).unwrap();
        let maker = recording.maker();
        let samples = recording.samples(&maker);
        let evaluated = (self.setting.mode, &self.setting.spec);
        let (registration, list) = (&self.registration, &self.list);
        recompute(&recording, &samples, evaluated, registration, list, secrets).unwrap()
    }
}

#[test]
fn the_recording_gives_the_registered_samples() {
    let audited = Audited::new();
    let same = Recomputed::Same { frames: 40 };
    assert_eq!(audited.with(&pickplace(), SECRET), same);
    let other = RegistrationSecret::new([4; 32]);
    assert_eq!(
        audited.with(&pickplace(), other.clone()),
        Recomputed::OtherSecret
    );
    // The node has registered again since, and its file has both secrets.
    let mut both = Secrets::default();
    both.add(SECRET);
    both.add(other);
    assert_eq!(audited.with_all(&pickplace(), &both), same);
}

/// The node has committed to values that it likes better than those of its recording.
#[test]
fn an_invented_sample_is_found() {
    let mut audited = Audited::new();
    audited.list[17].leaf = Digest([9; 32]);
    let found = Recomputed::OtherSamples {
        frames: vec![audited.list[17].frame],
        differ: 1,
        of: 40,
    };
    assert_eq!(audited.with(&pickplace(), SECRET), found);
    // The recording's pictures were exchanged after the node had recorded them.
    let mut audited = Audited::new();
    for drawn in &mut audited.list {
        drawn.leaf = Digest([9; 32]);
    }
    match audited.with(&pickplace(), SECRET) {
        Recomputed::OtherSamples {
            frames,
            differ: 40,
            of: 40,
        } => assert_eq!(frames.len(), 8),
        other => panic!("{other:?}"),
    }
}

#[test]
fn another_recording_is_named_by_its_episodes_or_features() {
    let mut audited = Audited::new();
    let dir = tempfile::tempdir().unwrap();
    let episode = MadeEpisode {
        seed: 1,
        frames: 20,
        still: false,
    };
    make(dir.path(), &[episode]);
    match audited.with(dir.path(), SECRET) {
        Recomputed::OtherEpisodes { missing, extra } => {
            let registered = audited.registration.episodes.iter();
            assert_eq!(
                missing,
                registered.map(|one| one.digest).collect::<Vec<_>>()
            );
            assert_eq!(extra.len(), 1);
        }
        other => panic!("{other:?}"),
    }
    // A registration with another number of frames in an episode would draw others.
    audited.registration.episodes[2].frames += 1;
    let wrong = vec![audited.registration.episodes[2].digest];
    match audited.with(&pickplace(), SECRET) {
        Recomputed::OtherEpisodes { missing, extra } => {
            assert_eq!((missing, extra), (wrong.clone(), wrong));
        }
        other => panic!("{other:?}"),
    }
    let other = pickplace().with_file_name("so101_pickplace");
    assert!(matches!(
        audited.with(&other, SECRET),
        Recomputed::OtherFeatures { .. }
    ));
}
