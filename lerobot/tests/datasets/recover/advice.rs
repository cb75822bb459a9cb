//! What is advised where a recording ended in its first episode, or a data file was cut off afterwards.

use super::*;

#[test]
fn where_no_episode_was_finished_it_has_to_be_recorded_again() {
    let root = unfinished("killed_in_first_episode");
    let errors = [
        Dataset::open(&root).unwrap_err(),
        recover(&root, &Out::new().path()).unwrap_err(),
    ];
    for error in errors {
        let reported = error.to_string();
        let begin = format!("{}: no episode was finished", root.display());
        assert!(reported.starts_with(&begin), "{reported}");
        assert!(reported.ends_with(": record again"), "{reported}");
        assert!(!reported.contains("copy it again"), "{reported}");
    }
}

#[test]
fn a_first_episode_with_rows_is_saved() {
    let root = unfinished("killed_in_first_encoding");
    let reported = Dataset::open(&root).unwrap_err().to_string();
    let sign = "(meta/info.json counts no episode, and ";
    let command = format!("zk0 dataset recover {} --out NEW_FOLDER", root.display());
    assert!(
        reported.contains(sign) && reported.contains(&command),
        "{reported}"
    );
    let out = Out::new();
    let (report, saved) = out.of(&root);
    compare(&saved, &[0], LOSSY);
    assert_eq!(lost(&report), [""; 0]);
}

#[test]
fn a_data_file_that_was_cut_off_names_both_ways_out() {
    let cut = |copy: &Copy, file: &str| {
        copy.edit(file, |bytes| bytes[..bytes.len() / 2].to_vec());
        copy.error().to_string()
    };
    let copy = copy_of("finished");
    let reported = cut(&copy, DATA);
    let root = copy.root().display();
    let advice = format!(
        "the file has no end: copy it again, or save the episodes before it with: zk0 dataset recover {root} --out NEW_FOLDER"
    );
    assert!(reported.contains("damaged parquet file: "), "{reported}");
    assert!(reported.ends_with(&advice), "{reported}");
    let out = Out::new();
    let (report, saved) = out.of(copy.root());
    // Half of such a small file is its index.
    compare(&saved, &[0, 1, 2, 3], 0.0);
    assert_eq!(lost(&report), [""; 0]);

    // `recover` saves no such recordings.
    for (name, file) in [
        (
            "so100_pickplace_v21",
            "data/chunk-000/episode_000001.parquet",
        ),
        ("../pictures/lerobot", DATA),
    ] {
        let reported = cut(&Copy::of(name), file);
        assert!(reported.contains("damaged parquet file: "), "{reported}");
        assert!(!reported.contains("recover"), "{reported}");
    }
}
