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
        let said = error.to_string();
        let begin = format!("{}: no episode was finished", root.display());
        assert!(said.starts_with(&begin), "{said}");
        assert!(said.ends_with(": record again"), "{said}");
        assert!(!said.contains("copy it again"), "{said}");
    }
}

#[test]
fn a_first_episode_with_rows_is_saved() {
    let root = unfinished("killed_in_first_encoding");
    let said = Dataset::open(&root).unwrap_err().to_string();
    let sign = "(meta/info.json counts no episode, and ";
    let command = format!("zk0 dataset recover {} --out NEW_FOLDER", root.display());
    assert!(said.contains(sign) && said.contains(&command), "{said}");
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
    let said = cut(&copy, DATA);
    let root = copy.root().display();
    let advice = format!(
        "the file has no end: copy it again, or save the episodes before it with: zk0 dataset recover {root} --out NEW_FOLDER"
    );
    assert!(said.contains("damaged parquet file: "), "{said}");
    assert!(said.ends_with(&advice), "{said}");
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
        let said = cut(&Copy::of(name), file);
        assert!(said.contains("damaged parquet file: "), "{said}");
        assert!(!said.contains("recover"), "{said}");
    }
}
