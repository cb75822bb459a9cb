//! The samples of an evaluation set stay on disk, and are made once.

use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_argument::claim::ClaimSource;
use zk0_node::error::ParticipantError;
use zk0_node::recording::secret::RegistrationSecret;
use zk0_node::recording::OpenRecording;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::PolicyError;
use zk0_testkit::micro_network::{pickplace, Setting};

/// All frames, but nothing can be made of them.
struct NothingMade;

impl SampleSource<PreparedSample> for NothingMade {
    fn len(&self) -> usize {
        245
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, PreparedSample>, PolicyError> {
        Err(PolicyError::Sample(format!("frame {index} is made again")))
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(folder).unwrap();
    let mut files: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_restart_makes_no_sample_again() {
    let setting = Setting::new();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let (maker, folder) = (recording.maker(), tempfile::tempdir().unwrap());
    let samples = recording.samples(&maker);
    let first = setting
        .set(&recording, &samples, folder.path(), 40)
        .commitment;
    let again = setting.set(&recording, &NothingMade, folder.path(), 40);
    assert_eq!(again.commitment, first);

    // A node that was killed goes on with the samples that are missing.
    let lost = &files(folder.path())[5];
    fs::rename(lost, lost.with_extension("unfinished")).unwrap();
    let again = setting.set(&recording, &samples, folder.path(), 40);
    assert_eq!(again.commitment, first);
    assert_eq!(files(folder.path()).len(), 40);

    // A larger number of frames keeps those that are there.
    let before = files(folder.path());
    let more = setting.set(&recording, &samples, folder.path(), 60);
    assert_eq!(more.commitment.samples, 60);
    let after = files(folder.path());
    assert!(after.len() == 60 && before.iter().all(|file| after.contains(file)));
}

/// A leaf of an older registration would show what hides the sample.
#[test]
fn under_another_secret_each_sample_is_made_again() {
    let setting = Setting::new();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let (maker, folder) = (recording.maker(), tempfile::tempdir().unwrap());
    let samples = recording.samples(&maker);
    let first = setting.set(&recording, &samples, folder.path(), 40);
    let secret = RegistrationSecret::new([4; 32]);
    let second = setting.set_under(secret, &recording, &samples, folder.path(), 40);
    assert_ne!(first.commitment.root, second.commitment.root);
    assert_eq!(files(folder.path()).len(), 80);
}

#[test]
fn a_damaged_sample_is_made_again_or_named() {
    let setting = Setting::new();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let (maker, folder) = (recording.maker(), tempfile::tempdir().unwrap());
    let samples = recording.samples(&maker);
    let set = setting.set(&recording, &samples, folder.path(), 10);
    let good: Vec<_> = files(folder.path())
        .into_iter()
        .map(|path| (fs::read(&path).unwrap(), path))
        .collect();
    // All samples are evaluated, so that each of them is read.
    let expected = setting.expected(&set, 0, 10);
    let input = |all: &dyn SampleSource<PreparedSample>| {
        let weights = setting.weights();
        set.private_input(all, &expected, weights.clone(), weights)
    };
    let before = input(&NothingMade).unwrap();
    let whole = before.whole().unwrap();
    for (number, (bytes, path)) in good.iter().enumerate() {
        let mut damaged = bytes.clone();
        damaged[100] ^= 1;
        match number % 3 {
            0 => fs::write(path, damaged).unwrap(),
            1 => fs::write(path, &bytes[..50]).unwrap(),
            _ => fs::remove_file(path).unwrap(),
        }
        // Without the recording the node states which file is damaged.
        let error = input(&NothingMade).unwrap_err().to_string();
        assert!(error.contains("is made again"), "{error}");
        // With another recording in its place it does not prove what it did not commit to.
        let other = Other(&samples);
        match input(&other) {
            Err(ParticipantError::OtherSample { damaged, .. }) => {
                assert!(damaged.contains(path.to_str().unwrap()), "{damaged}");
            }
            other => panic!("{other:?}"),
        }
        let again = input(&samples).unwrap();
        assert_eq!(again.whole().unwrap(), whole);
        assert_eq!(fs::read(path).unwrap(), *bytes);
    }
}

/// The samples of a recording, each changed a little.
struct Other<'a>(&'a dyn SampleSource<PreparedSample>);

impl SampleSource<PreparedSample> for Other<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, PreparedSample>, PolicyError> {
        let mut sample = self.0.sample(index)?.into_owned();
        sample.keys[0][0] += 1.0;
        Ok(Cow::Owned(sample))
    }
}
