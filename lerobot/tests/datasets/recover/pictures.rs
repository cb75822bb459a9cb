//! Recordings with pictures in place of videos (`use_videos=False`): the rows hold them, or name their files.

use arrow_array::{ArrayRef, BinaryArray, StructArray};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zk0_testkit::recordings::fixtures;

use super::statistics::{cell, same_as_lerobots, NAMES};
use super::*;

/// Compares the saved episodes with those that were recorded under these numbers, to the last bit.
#[track_caller]
fn same_frames(saved: &Dataset, whole: &Dataset, recorded: &[usize]) {
    let of = |dataset: &Dataset| -> Vec<_> { frames(dataset, 1).map(Result::unwrap).collect() };
    let (new, old) = (of(saved), of(whole));
    assert_eq!(saved.episodes().len(), recorded.len());
    for (episode, &number) in saved.episodes().iter().zip(recorded) {
        let same = whole.episodes()[number].frames.clone();
        assert_eq!(episode.frames.len(), same.len());
        for (new, old) in new[episode.frames.clone()].iter().zip(&old[same]) {
            assert_eq!((&new.state, &new.actions), (&old.state, &old.actions));
            assert_eq!(new.task, old.task);
            assert!(new.images == old.images);
        }
    }
}

fn whole() -> Dataset {
    Dataset::open(unfinished("pictures_finished")).unwrap()
}

#[test]
fn killed_in_an_episode() {
    let out = Out::new();
    let (report, saved) = out.of(&unfinished("pictures_killed_in_episode"));
    same_frames(&saved, &whole(), &[0, 1, 2]);
    assert_eq!(lost(&report), [NO_ROWS]);
    assert!(report.notes.is_empty(), "{:?}", report.notes);
    same_as_lerobots(&out.path(), &unfinished("pictures_finished"), 3, &NAMES);
    assert!(!out.path().join("images").exists());
}

/// The rows of the third episode are there, and so are the files of its pictures.
#[test]
fn killed_before_the_files_of_pictures_are_removed() {
    let out = Out::new();
    let (report, saved) = out.of(&unfinished("pictures_killed_in_saving"));
    same_frames(&saved, &whole(), &[0, 1, 2]);
    assert_eq!((lost(&report).len(), report.notes.len()), (0, 0));
    same_as_lerobots(&out.path(), &unfinished("pictures_finished"), 3, &NAMES);
}

/// LeRobot's statistics are of 100 of these 120 pictures, and of every second row and column.
#[test]
fn many_large_pictures_count_as_lerobot_counts_them() {
    let recorded = unfinished("pictures_sampled");
    let out = Out::new();
    let (_, saved) = out.of(&recorded);
    same_frames(&saved, &Dataset::open(&recorded).unwrap(), &[0]);
    let names = NAMES.iter().copied().filter(|name| *name != "std");
    let names: Vec<&str> = names.collect();
    let found = same_as_lerobots(&out.path(), &recorded, 1, &names);
    // The blue of the second camera is 100, 102, 104 or 106. LeRobot adds the squares in float32, and its deviation is wrong.
    let (deviations, _) = cell(&found, "observation.images.wrist", "std", 0);
    let right = f64::sqrt(5.0) / 255.0;
    assert!((deviations[2] - right).abs() < 1e-12, "{deviations:?}");
}

#[test]
fn pictures_in_files_beside_are_written_into_the_rows() {
    let copy = Copy::of("../pictures/lerobot");
    copy.add(&fixtures().join("pictures/beside"));
    let intact = Dataset::open(recording("../pictures/lerobot")).unwrap();
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    assert_eq!((report.lost.len(), report.notes.len()), (0, 0));
    assert!(!out.path().join("images").exists());
    same_frames(&saved, &intact, &[0, 1]);
    // A file that is not there any more takes its episode with it.
    let missing = "images/observation.images.top/episode-000001/frame-000002.png";
    fs::remove_file(copy.path(missing)).unwrap();
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    same_frames(&saved, &intact, &[0]);
    let missing = copy.path(missing);
    let cause = format!(
        "episode 1: frame 2, camera observation.images.top: {}",
        missing.display()
    );
    assert!(lost(&report)[0].starts_with(&cause), "{report:?}");
}

#[test]
fn pictures_and_videos_of_one_recording_are_both_saved() {
    let mixed = recording("../pictures/mixed");
    let out = Out::new();
    let (report, saved) = out.of(&mixed);
    assert_eq!((report.lost.len(), report.notes.len()), (0, 0));
    same_frames(&saved, &Dataset::open(&mixed).unwrap(), &[0, 1]);
}

#[test]
fn an_episode_with_a_damaged_picture_in_its_rows_is_lost() {
    let copy = copy_of("pictures_killed_in_episode");
    copy.edit(DATA, |mut bytes| {
        let first = bytes.windows(4).position(|w| w == b"\x89PNG").unwrap();
        bytes[first + 60] ^= 0xff;
        bytes
    });
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    same_frames(&saved, &whole(), &[1, 2]);
    let cause = "episode 0: frame 0, camera observation.images.top: ";
    assert!(lost(&report)[0].starts_with(cause), "{report:?}");
}

#[test]
fn data_files_are_as_large_as_the_metadata_says() {
    let copy = copy_of("pictures_killed_in_episode");
    let size = "\"data_files_size_in_mb\": ";
    copy.edit_text(INFO, &format!("{size}100"), &format!("{size}0"));
    let out = Out::new();
    let (_, saved) = out.of(copy.root());
    same_frames(&saved, &whole(), &[0, 1, 2]);
    let data = out.path().join("data/chunk-000");
    assert_eq!(fs::read_dir(data).unwrap().count(), 3);
}

#[test]
fn a_large_episode_is_not_held_until_its_end() {
    let copy = Copy::of("../pictures/lerobot");
    copy.edit_rows(|rows| {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        // What follows the end of a PNG is not read.
        let mut larger = |bytes: Option<&[u8]>| {
            let mut rest = vec![0; 3 << 20];
            random.fill_bytes(&mut rest);
            [bytes.unwrap(), &rest].concat()
        };
        let columns = rows.columns().iter().map(|column| -> ArrayRef {
            let Some(cells) = column.as_struct_opt() else {
                return column.clone();
            };
            let bytes = cells.column(0).as_binary::<i32>().iter().map(&mut larger);
            let bytes: ArrayRef = Arc::new(BinaryArray::from_iter_values(bytes));
            let parts = vec![bytes, cells.column(1).clone()];
            Arc::new(StructArray::new(cells.fields().clone(), parts, None))
        });
        RecordBatch::try_new(rows.schema(), columns.collect()).unwrap()
    });
    let out = Out::new();
    let (_, saved) = out.of(copy.root());
    same_frames(
        &saved,
        &Dataset::open(recording("../pictures/lerobot")).unwrap(),
        &[0, 1],
    );
    let file = fs::File::open(out.path().join(DATA)).unwrap();
    let written = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
    // Each of the two episodes has more than 16 MiB.
    assert_eq!(written.metadata().num_row_groups(), 4);
}

#[test]
fn damaged_bytes_end_in_an_error_or_in_pictures_that_decode() {
    let copy = copy_of("pictures_killed_in_episode");
    let whole = fs::read(copy.path(DATA)).unwrap();
    for at in (0..whole.len()).step_by(37) {
        copy.edit(DATA, |_| {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            bytes
        });
        let out = Out::new();
        if recover(copy.root(), &out.path()).is_ok() {
            let saved = Dataset::open(out.path()).unwrap();
            assert!(saved.picture_faults(|_, _| ()).is_empty(), "{at}");
        } else {
            assert_eq!(out.names().len(), 0);
        }
    }
}
