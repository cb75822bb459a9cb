//! Damaged pictures and videos: their episodes are lost, and no others.

use super::*;

/// A disk that lost power leaves such pictures.
#[test]
fn an_episode_with_a_damaged_picture_is_lost() {
    let picture = "images/observation.images.top/episode-000001/frame-000001.png";
    type Damage = fn(&mut Vec<u8>);
    let damages: [(Damage, &str); 3] = [
        (
            |bytes| bytes.truncate(bytes.len() / 2),
            "the PNG picture is damaged",
        ),
        (|bytes| bytes.resize(2 << 20, 0), "cannot be read"),
        (
            |bytes| bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]),
            "",
        ),
    ];
    for (damage, cause) in damages {
        let copy = copy_of("killed_in_batch");
        copy.edit(picture, |mut bytes| {
            damage(&mut bytes);
            bytes
        });
        let out = Out::new();
        let (report, saved) = out.of(copy.root());
        compare(&saved, &[0, 2], LOSSY);
        let path = copy.path(picture);
        let cause = format!("episode 1: {}: {cause}", path.display());
        assert!(lost(&report)[0].starts_with(&cause), "{report:?}");
    }
}

/// A copy of a recording that is cut off can be read up to there, and LeRobot fails at the first picture that is missing.
#[test]
fn episodes_of_a_damaged_video_are_lost() {
    let video = "videos/observation.images.top/chunk-000/file-000.mp4";
    let damages: [fn(&mut Vec<u8>); 2] = [|bytes| bytes.truncate(bytes.len() * 6 / 10), Vec::clear];
    for damage in damages {
        let copy = Copy::of("so100_sorting_two");
        copy.edit(video, |mut bytes| {
            damage(&mut bytes);
            bytes
        });
        copy.open().unwrap();
        let error = recover(copy.root(), &Out::new().path()).unwrap_err();
        let lost = format!(
            "no episode can be saved:\nepisode 0: {}: ",
            copy.path(video).display()
        );
        assert!(error.to_string().contains(&lost), "{error}");
    }
}
