//! Image transforms are for training alone.

use zk0_circuits::NodeId;
use zk0_node::recording::OpenRecording;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::image_transforms::{ImageTransformsConfig, Variants};
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_testkit::micro_network::{pickplace, Setting};

/// A node that trains on transformed frames commits to the samples of the frames as they are recorded, whatever the cache holds.
#[test]
fn the_evaluation_set_is_never_transformed() {
    let setting = Setting::new();
    let plain = setting.registered(&pickplace(), None, 40);
    let config = ImageTransformsConfig {
        enable: true,
        ..ImageTransformsConfig::default()
    };
    let variants = Variants::new(&config, 2, 0).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), Some(&cache)).unwrap();
    let maker = recording.maker().with_variants(variants.clone());
    let training = recording.training_samples(&maker, variants.as_ref());
    let samples = recording.samples(&maker);
    assert_eq!(training.len(), 2 * samples.len());
    // The variants are in the cache before the evaluation set is prepared.
    for frame in 0..recording.len() {
        let variant = training.sample(2 * frame).unwrap();
        let recorded = samples.sample(frame).unwrap();
        assert!(variant.keys != recorded.keys, "frame {frame}");
        assert_eq!(variant.actions, recorded.actions);
    }
    let folder = tempfile::tempdir().unwrap();
    let set = setting.set(&recording, &samples, folder.path(), 40);
    assert_eq!(set.registration(NodeId([1; 32])), plain);
}
