//! Pictures in place of videos, in files of their own.

use super::*;
use zk0_testkit::recordings::{fixtures, frames, Copy};

/// LeRobot with `use_videos=False` writes them, if it is not told to put them into the tables.
#[test]
fn pictures_in_files_of_their_own_are_fetched() {
    let copy = Copy::empty();
    for name in ["lerobot", "beside"] {
        copy.add(&fixtures().join("pictures").join(name));
    }
    // A process that was killed leaves pictures of cameras with videos, and others may lie there, too.
    let left = "images/observation.images.left/episode-000000/frame-000000.png";
    fs::create_dir_all(copy.path(left).parent().unwrap()).unwrap();
    fs::write(copy.path(left), "not wanted").unwrap();
    let (hub, cache) = (Hub::serving(copy.root(), Manners::default()), cache());
    let options = hub.options(cache.path());
    let mut last = None;
    let fetched = fetch(&NAME.parse().unwrap(), &options, &mut |at| last = Some(at)).unwrap();
    let (ours, like) = (Dataset::open(fetched.folder).unwrap(), copy.open().unwrap());
    let all = |dataset: &Dataset| frames(dataset, 2).map(Result::unwrap).collect::<Vec<_>>();
    assert!(all(&ours) == all(&like));
    let asked = hub.asked();
    let pictures = asked.iter().filter(|path| path.contains("/images/"));
    assert!(pictures.count() >= 2 * like.len());
    assert!(!asked.iter().any(|path| path.contains("left")));
    let last = last.unwrap();
    assert_eq!((last.files, last.bytes), (last.of_files, last.of_bytes));

    let copy = Copy::of("so101_pickplace");
    let left = "images/observation.images.up/episode-000006/frame-000000.png";
    fs::create_dir_all(copy.path(left).parent().unwrap()).unwrap();
    fs::write(copy.path(left), "not wanted").unwrap();
    let (hub, cache) = (Hub::serving(copy.root(), Manners::default()), self::cache());
    let folder = get(&hub.options(cache.path())).unwrap();
    is_whole(&folder, "so101_pickplace");
}
