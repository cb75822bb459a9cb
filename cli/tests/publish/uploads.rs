//! Folders on a Hub on loopback: what it gets, what a second run uploads, and what is stated when it fails.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use zk0::hub::target::RetryPolicy;
use zk0::hub::{publish, PublishError, PublishTarget, PublishedCommit};
use zk0_testkit::local_hub::{LocalHub, READER, TOKEN};

const NAME: &str = "robots/arm";

fn target(hub: &LocalHub, token: &str) -> PublishTarget {
    let endpoint = format!("{}/", hub.address);
    let target = PublishTarget::new(NAME.parse().unwrap(), Some(endpoint), Some(token.into()));
    PublishTarget {
        patience: RetryPolicy {
            tries: 3,
            first_wait: Duration::from_millis(1),
        },
        ..target.unwrap()
    }
}

/// A folder with a large file and two small ones.
fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let weights: Vec<u8> = (0..3_000_000u32).map(|at| (at % 251) as u8).collect();
    fs::write(dir.path().join("model.safetensors"), weights).unwrap();
    fs::write(dir.path().join("config.json"), r#"{"type": "smolvla"}"#).unwrap();
    fs::write(dir.path().join("README.md"), "# An arm").unwrap();
    dir
}

/// Whether the repository has the files of the folder and no others.
#[track_caller]
fn holds(hub: &LocalHub, folder: &Path) {
    let files = hub.model(NAME).files;
    let here: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|one| one.unwrap())
        .collect();
    assert_eq!(files.len(), here.len());
    for entry in here {
        let name = entry.file_name().into_string().unwrap();
        assert!(files[&name] == fs::read(entry.path()).unwrap(), "{name}");
    }
}

fn uploads(hub: &LocalHub) -> usize {
    let asked = hub.asked();
    asked.iter().filter(|one| one.starts_with("PUT ")).count()
}

#[test]
fn a_folder_is_published_and_a_second_run_uploads_only_what_is_new() {
    let (hub, folder) = (LocalHub::start(), folder());
    let target = target(&hub, TOKEN);
    let first = publish(&target, folder.path(), "Round 3").unwrap();
    let commit = |number: usize| Some(format!("{number:040x}"));
    let expected = |commit, changed, uploaded| PublishedCommit {
        commit,
        changed,
        uploaded,
    };
    assert_eq!(first, expected(commit(1), 3, 1));
    holds(&hub, folder.path());
    let model = hub.model(NAME);
    assert!(!model.private);
    assert_eq!(model.commits[0].summary, "Round 3");
    assert_eq!(
        model.large.keys().collect::<Vec<_>>(),
        ["model.safetensors"]
    );
    assert_eq!(uploads(&hub), 1);

    let again = publish(&target, folder.path(), "Round 3").unwrap();
    assert_eq!(again, expected(None, 0, 0));
    assert_eq!(uploads(&hub), 0);
    assert_eq!(hub.model(NAME).commits.len(), 1);

    fs::write(folder.path().join("README.md"), "# A better arm").unwrap();
    let changed = publish(&target, folder.path(), "Round 4").unwrap();
    assert_eq!(changed, expected(commit(2), 1, 0));
    assert_eq!(hub.model(NAME).commits[1].changed, ["README.md"]);
    holds(&hub, folder.path());

    let mut weights = fs::read(folder.path().join("model.safetensors")).unwrap();
    weights[1_000_000] ^= 1;
    fs::write(folder.path().join("model.safetensors"), weights).unwrap();
    let changed = publish(&target, folder.path(), "Round 5").unwrap();
    assert_eq!(changed, expected(commit(3), 1, 1));
    holds(&hub, folder.path());
}

#[test]
fn an_empty_file_travels_within_the_commit_and_an_ignored_one_does_not_travel() {
    let (hub, folder) = (LocalHub::start(), folder());
    fs::write(folder.path().join("empty"), "").unwrap();
    fs::write(folder.path().join("ignored"), "not wanted").unwrap();
    let private = PublishTarget {
        private: true,
        ..target(&hub, TOKEN)
    };
    publish(&private, folder.path(), "Round 3").unwrap();
    fs::remove_file(folder.path().join("ignored")).unwrap();
    holds(&hub, folder.path());
    assert!(hub.model(NAME).private);
}

#[test]
fn a_wrong_token_and_a_missing_right_are_told_apart() {
    let (hub, folder) = (LocalHub::start(), folder());
    let wrong = publish(&target(&hub, "hf_wrong"), folder.path(), "Round").unwrap_err();
    assert!(matches!(wrong, PublishError::Token { .. }), "{wrong}");
    let reported = wrong.to_string();
    for text in [
        "HTTP 401: Invalid username",
        "set HF_TOKEN",
        NAME,
        &hub.address,
    ] {
        assert!(reported.contains(text), "{reported}");
    }
    assert!(!reported.contains("hf_wrong"), "{reported}");

    let reader = publish(&target(&hub, READER), folder.path(), "Round").unwrap_err();
    assert!(matches!(reader, PublishError::Forbidden { .. }), "{reader}");
    let reported = reader.to_string();
    for text in [
        "HTTP 403: You don't have the rights.",
        "role \"write\"",
        NAME,
    ] {
        assert!(reported.contains(text), "{reported}");
    }
    // Each was asked once: to repeat it would be of no use.
    assert_eq!(
        hub.asked()
            .iter()
            .filter(|one| one.contains("create"))
            .count(),
        2
    );
    assert!(hub.held().models.is_empty());

    let none = PublishTarget::new(NAME.parse().unwrap(), None, None);
    let none = none.err().unwrap().to_string();
    assert!(none.contains("set HF_TOKEN"), "{none}");
}

#[test]
fn a_token_that_may_create_no_repository_writes_to_one_that_is_there() {
    for status in [401, 402, 403] {
        let (hub, folder) = (LocalHub::start(), folder());
        hub.held().closed = Some(status);
        let refused = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
        let refused = refused.to_string();
        assert!(refused.contains(&format!("HTTP {status}")), "{refused}");
        hub.held().models.insert(NAME.into(), Default::default());
        publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap();
        holds(&hub, folder.path());
    }
}

#[test]
fn a_commit_after_somebody_else_s_is_made_again() {
    let (hub, folder) = (LocalHub::start(), folder());
    hub.held().failing = Some(("commit", 412, 1));
    publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap();
    holds(&hub, folder.path());
    // What the repository has was asked for again.
    let asked = hub.asked();
    let count = |text: &str| asked.iter().filter(|one| one.contains(text)).count();
    assert_eq!((count("preupload"), count("commit")), (2, 2));
}

#[test]
fn a_hub_that_fails_is_asked_again_for_a_while() {
    let steps = [
        "create",
        "preupload",
        "batch",
        "storage",
        "verify",
        "commit",
    ];
    for (step, status) in steps.into_iter().zip([500, 502, 503, 500, 504, 429]) {
        let (hub, folder) = (LocalHub::start(), folder());
        hub.held().failing = Some((step, status, 2));
        let published = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap();
        assert_eq!(published.changed, 3, "{step}");
        holds(&hub, folder.path());
        // What had arrived before was not uploaded again.
        let expected = if step == "storage" { 3 } else { 1 };
        assert_eq!(uploads(&hub), expected, "{step}");
        assert_eq!(hub.model(NAME).commits.len(), 1, "{step}");

        if step == "verify" {
            // The second try finds the file there.
            continue;
        }
        let (hub, begun) = (LocalHub::start(), Instant::now());
        hub.held().failing = Some((step, status, usize::MAX));
        let error = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
        let reported = error.to_string();
        assert!(reported.contains("failed 3 times"), "{reported}");
        assert!(reported.contains(&format!("HTTP {status}")), "{reported}");
        assert!(reported.contains("try again later"), "{reported}");
        assert!(begun.elapsed() < Duration::from_secs(20));
        let asked = hub.asked();
        assert_eq!(asked.iter().filter(|one| one.contains(step)).count(), 3);

        // It is mended, and the same command again does what was left.
        hub.held().failing = None;
        publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap();
        holds(&hub, folder.path());
        assert_eq!(uploads(&hub), usize::from(step != "commit"), "{step}");
    }
}

#[test]
fn a_cut_connection_loses_nothing() {
    let (hub, folder) = (LocalHub::start(), folder());
    hub.held().cuts = 2;
    publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap();
    holds(&hub, folder.path());
    assert_eq!(uploads(&hub), 3);

    let hub = LocalHub::start();
    hub.held().cuts = usize::MAX;
    let error = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
    let reported = error.to_string();
    let what = "uploading model.safetensors (3000000 bytes) failed 3 times";
    assert!(reported.contains(what), "{reported}");
    assert!(hub.model(NAME).commits.is_empty());
}

#[test]
fn nobody_listens() {
    let folder = folder();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    drop(listener);
    let hub = PublishTarget {
        endpoint: address,
        ..target(&LocalHub::start(), TOKEN)
    };
    let error = publish(&hub, folder.path(), "Round").unwrap_err();
    assert!(
        matches!(error, PublishError::Unavailable { tries: 3, .. }),
        "{error}"
    );
}

#[test]
fn the_token_goes_to_nobody_but_the_hub() {
    let (hub, folder) = (LocalHub::start(), folder());
    hub.held().verify_elsewhere = true;
    let error = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
    assert!(
        error.to_string().contains("http://127.0.0.1:9/verify"),
        "{error}"
    );
    assert!(hub.model(NAME).commits.is_empty());
}

#[test]
fn what_is_no_hub_and_what_is_no_folder_is_named() {
    let (hub, folder) = (LocalHub::start(), folder());
    hub.held().failing = Some(("preupload", 200, usize::MAX));
    let error = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
    assert!(matches!(error, PublishError::Answer { .. }), "{error}");
    hub.held().failing = Some(("commit", 400, usize::MAX));
    let error = publish(&target(&hub, TOKEN), folder.path(), "Round").unwrap_err();
    assert!(
        error.to_string().contains("HTTP 400: it is broken"),
        "{error}"
    );

    let nothing = folder.path().join("nothing");
    let error = publish(&target(&hub, TOKEN), &nothing, "Round").unwrap_err();
    assert!(
        error.to_string().contains(nothing.to_str().unwrap()),
        "{error}"
    );
}
