//! Recordings that are trained on together have to be alike.

use zk0_lerobot::dataset::{refuse_different, Info};
use zk0_testkit::recordings::{recording, Copy, INFO};

/// The error of training on a good recording together with a copy of it in which one text of `meta/info.json` is another.
fn refused(from: &str, to: &str) -> Option<String> {
    let good = recording("so100_pickplace");
    let copy = Copy::default();
    copy.edit_text(INFO, from, to);
    let infos = [good.as_path(), copy.root()].map(|root| (root, Info::read(root).unwrap()));
    let error = refuse_different(infos.iter().map(|(root, info)| (*root, info))).err()?;
    let error = error.to_string();
    let names_both =
        error.starts_with(copy.root().to_str().unwrap()) && error.contains(good.to_str().unwrap());
    assert!(names_both, "{error}");
    Some(error)
}

#[test]
fn what_lerobot_s_merge_refuses_is_refused() {
    let cases = [
        (
            "\"fps\": 30",
            "\"fps\": 15",
            "has 15 frames per second, not 30",
        ),
        (
            "\"main_shoulder_pan\"",
            "\"main_gripper\"",
            "of the joints [\"main_gripper\", \"main_shoulder_lift\"",
        ),
        (
            "\"observation.images.wrist\"",
            "\"observation.images.side\"",
            "has the cameras {\"observation.images.side\", \"observation.images.top\"} (--rename-map gives them other names), not {\"observation.images.top\", ",
        ),
    ];
    for (from, to, cause) in cases {
        let error = refused(from, to).expect(cause);
        assert!(error.contains(cause), "{error}");
    }
}

#[test]
fn joints_without_names_are_compared_by_their_number() {
    let good = recording("so100_pickplace");
    let named = Info::read(&good).unwrap();
    let mut nameless = named.clone();
    nameless.action.names.clear();
    let refused = |infos: [&Info; 2]| {
        let infos = infos.map(|info| (good.as_path(), info));
        refuse_different(infos).err().map(|error| error.to_string())
    };
    assert_eq!(refused([&named, &nameless]), None);
    assert_eq!(refused([&nameless, &named]), None);
    let mut wide = nameless.clone();
    wide.action.dim = 7;
    let error = refused([&nameless, &wide]).unwrap();
    assert!(
        error.contains("has 7 dimensions of action, not 6"),
        "{error}"
    );
}

#[test]
fn a_robot_s_name_and_the_videos_of_a_recording_may_differ() {
    assert_eq!(refused("\"so100\"", "\"so100_follower\""), None);
    let alike = ["so100_pickplace", "so100_sorting", "so100_pickplace_v21"].map(recording);
    let alike = alike.map(|root| (Info::read(&root).unwrap(), root));
    refuse_different(alike.iter().map(|(info, root)| (root.as_path(), info))).unwrap();
}
