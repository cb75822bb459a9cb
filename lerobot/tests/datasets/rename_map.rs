//! Cameras under other names.

use zk0_lerobot::dataset::{Dataset, RenameMap};
use zk0_testkit::recordings::{fixtures, recording};

const TOP: &str = "observation.images.top";
const WRIST: &str = "observation.images.wrist";

fn map(json: &str) -> RenameMap {
    json.parse().unwrap()
}

fn names(dataset: &Dataset) -> Vec<&str> {
    dataset.cameras().iter().map(|c| c.name.as_str()).collect()
}

/// Videos and pictures are found under the names in the files, and the digest of the features is of the new names.
#[test]
fn cameras_change_names_at_once_and_keep_their_pictures() {
    for folder in [
        recording("so100_pickplace"),
        recording("so100_pickplace_v21"),
        fixtures().join("pictures/lerobot"),
    ] {
        let plain = Dataset::open(&folder).unwrap();
        let exchange = map(r#"{"top": "wrist", "observation.images.wrist": "top"}"#);
        let renamed = Dataset::open(&folder).unwrap().renamed(&exchange).unwrap();
        let reversed: Vec<_> = names(&plain).into_iter().rev().collect();
        assert_eq!(names(&renamed), reversed);
        let (before, after) = (plain.frame(3, 5).unwrap(), renamed.frame(3, 5).unwrap());
        assert_eq!(before.images, after.images);
        assert_ne!(plain.feature_spec_digest(5), renamed.feature_spec_digest(5));
    }
}

#[test]
fn a_name_that_no_recording_has_is_refused() {
    let dataset = || Dataset::open(recording("so100_pickplace")).unwrap();
    let error = dataset().renamed(&map(r#"{"front": "side"}"#)).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("--rename-map names \"observation.images.front\", and the cameras are [\"observation.images.top\""),
        "{text}"
    );
    // One of two recordings may lack it.
    let front = dataset().renamed(&map(r#"{"top": "front"}"#)).unwrap();
    let both = map(r#"{"front": "top"}"#)
        .applied(vec![dataset(), front])
        .unwrap();
    for dataset in both {
        assert_eq!(names(&dataset), [TOP, WRIST]);
    }
}

#[test]
fn two_cameras_of_one_name_are_refused() {
    let dataset = Dataset::open(recording("so100_pickplace")).unwrap();
    let error = dataset.renamed(&map(r#"{"top": "wrist"}"#)).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("calls two cameras \"observation.images.wrist\""),
        "{error}"
    );
}

#[test]
fn what_is_no_map_is_refused() {
    for (json, why) in [
        ("top=wrist", "no JSON object of names"),
        (r#"{"top": 1}"#, "no JSON object of names"),
    ] {
        let error = json.parse::<RenameMap>().unwrap_err();
        assert!(error.contains(why), "{error}");
    }
    let many: Vec<_> = (0..65).map(|i| format!("\"a{i}\": \"b{i}\"")).collect();
    let error = format!("{{{}}}", many.join(","))
        .parse::<RenameMap>()
        .unwrap_err();
    assert!(error.contains("65 cameras, more than 64"), "{error}");
}
