//! Listings and answers that are not what they should be, and what an earlier download left.

use super::*;

#[test]
fn what_was_left_in_the_cache_is_no_hindrance() {
    let (hub, cache) = (Hub::start("so101_pickplace", Manners::default()), cache());
    let options = hub.options(cache.path());
    let folder = get(&options).unwrap();
    // The content of one file is gone, and its name in the snapshot leads nowhere.
    fs::remove_file(fs::canonicalize(folder.join(DATA)).unwrap()).unwrap();
    is_whole(&get(&options).unwrap(), "so101_pickplace");
    // An earlier attempt got more than the file has, and did not give it its name.
    let content = fs::canonicalize(folder.join(DATA)).unwrap();
    let part = content.with_extension("part");
    fs::rename(&content, &part).unwrap();
    let longer = [fs::read(&part).unwrap(), vec![7]].concat();
    fs::write(part, longer).unwrap();
    is_whole(&get(&options).unwrap(), "so101_pickplace");
    // A copy of the cache has files in place of links, and one is cut off. What it is about and its content are asked for once.
    let name = folder.join(DATA);
    fs::remove_file(&name).unwrap();
    fs::write(&name, b"PAR1").unwrap();
    hub.asked();
    is_whole(&get(&options).unwrap(), "so101_pickplace");
    let asked = hub.asked();
    let of_it = asked.iter().filter(|path| path.ends_with(DATA));
    assert_eq!(of_it.count(), 2, "{asked:?}");
}

/// The library panics here.
#[test]
fn an_answer_without_a_header_that_it_needs_is_an_error() {
    let manners = Manners {
        leads_nowhere: true,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let error = get(&hub.options(cache.path())).unwrap_err();
    assert!(matches!(error, HubError::OtherFile { .. }), "{error}");
    assert!(
        error
            .to_string()
            .contains("lacks what an answer has to have"),
        "{error}"
    );
}

#[test]
fn listings_that_are_none_are_refused() {
    let refused = |text, other, spaces| {
        let manners = Manners {
            other_listing: Some((text, other)),
            spaces,
            ..Manners::default()
        };
        let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
        get(&hub.options(cache.path())).unwrap_err()
    };
    for (text, other, cause) in [
        (COMMIT, "main", "\"main\" is no commit"),
        (COMMIT, "0123abcd", "\"0123abcd\" is no commit"),
        // The cache names the content of a file after this.
        ("\"blobId\":\"", "\"blobId\":\"../", "file \"meta/"),
    ] {
        let error = refused(text, other, 0);
        assert!(matches!(error, HubError::Listing { .. }), "{error}");
        assert!(error.to_string().contains(cause), "{error}");
    }
    let error = refused("meta/info.json", "meta/other.json", 0);
    assert!(matches!(error, HubError::NoDataset { .. }), "{error}");
    let error = refused(COMMIT, COMMIT, 64 << 20).to_string();
    assert!(error.contains("limit"), "{error}");
}

#[test]
fn listings_cannot_write_outside_the_cache() {
    for path in ["meta/../../../../escaped", "data/./x", "videos//x"] {
        let manners = Manners {
            extra: Some(path),
            ..Manners::default()
        };
        let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
        let error = match get(&hub.options(cache.path())) {
            Err(error) => error,
            // Some of these paths are harmless spellings of a path within the cache. They may end as a file that is not there.
            Ok(_) => panic!("{path} was fetched"),
        };
        match path.contains("..") {
            true => assert!(matches!(error, HubError::Listing { .. }), "{error}"),
            false => assert!(matches!(error, HubError::OtherFile { .. }), "{error}"),
        }
    }
}

#[test]
fn a_commit_that_was_fetched_whole_is_not_asked_for_again() {
    let manners = Manners {
        cuts: usize::MAX,
        ..Manners::default()
    };
    let (hub, cache) = (Hub::start("so101_pickplace", manners), cache());
    let options = hub.options(cache.path());
    let commit: HubRecording = format!("{NAME}@{COMMIT}").parse().unwrap();
    // What has come in part does not count.
    get(&options).unwrap_err();
    hub.asked();
    fetch(&commit, &options, &mut |_| ()).unwrap_err();
    assert_ne!(hub.asked(), [""; 0]);

    hub.manners.lock().unwrap().cuts = 0;
    let folder = get(&options).unwrap();
    hub.asked();
    let fetched = fetch(&commit, &options, &mut |_| ()).unwrap();
    assert_eq!((fetched.folder, &fetched.commit[..]), (folder, COMMIT));
    assert_eq!(hub.asked(), [""; 0]);
}
