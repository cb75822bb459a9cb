//! The samples of an evaluation set are made one at a time and read one at a time, so memory does not grow with their number.

use std::fs;
use zk0_argument::claim::ClaimSource;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording::{prepare_samples, OpenRecording};
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_testkit::allocations::{alone, peak};
use zk0_testkit::micro_network::{pickplace, Setting};

#[test]
fn memory_does_not_grow_with_the_samples_of_the_evaluation_set() {
    let _alone = alone();
    let setting = Setting::new();
    let dataset = Dataset::open(pickplace()).unwrap();
    // The frames are in memory before, so that only what the evaluation set itself holds is counted.
    let frames = prepare_samples(&dataset, &setting.file, None).unwrap();
    let frames = SamplesInMemory::new(&setting.file.policy.config, &frames).unwrap();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let measured = |count: u32| {
        let folder = tempfile::tempdir().unwrap();
        let prepare = || setting.set(&recording, &frames, folder.path(), count);
        let (set, prepared) = peak(prepare);
        let size = fs::read_dir(folder.path()).unwrap().next().unwrap();
        let size = size.unwrap().metadata().unwrap().len() as usize;
        let (expected, weights) = (setting.expected(&set, 1, 5), setting.weights());
        let update = weights.clone();
        let (input, opened) = peak(|| set.private_input(&frames, &expected, weights, update));
        assert_eq!(input.unwrap().places().len(), 5);
        (prepared, opened, size)
    };
    measured(20);
    let (few, few_opened, size) = measured(20);
    let (many, many_opened, _) = measured(220);
    // For each frame a node keeps its name, its digest and its leaf. The vectors double as they grow.
    let each = many.saturating_sub(few) / 200;
    assert!(
        each < size,
        "{each} bytes for each frame; a sample has {size}"
    );
    let each = many_opened.saturating_sub(few_opened) / 200;
    assert!(
        each < 40,
        "{each} bytes for each frame of the evaluation set"
    );
}
