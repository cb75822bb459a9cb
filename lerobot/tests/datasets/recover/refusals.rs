//! What cannot be recovered, and where the new folder may not be.

use super::*;

#[test]
fn what_cannot_be_saved_is_said_so() {
    let fails = |change: &dyn Fn(&Copy), cause: &str| {
        let copy = copy_of("killed_in_batch");
        change(&copy);
        let out = Out::new();
        let error = recover(copy.root(), &out.path()).unwrap_err().to_string();
        assert!(error.contains(cause), "{cause:?} is not in {error}");
        assert_eq!(out.names().len(), 0);
    };
    let remove =
        |folder: &'static str| move |copy: &Copy| fs::remove_dir_all(copy.path(folder)).unwrap();
    fails(
        &remove("images"),
        "no episode can be saved:\nepisode 0: 5 rows, and observation.images.top left none",
    );
    fails(&remove("data"), "episode 0: it has pictures and no rows");
    fails(
        &|copy| copy.edit(INFO, |_| Vec::new()),
        "nothing can be recovered without it",
    );
    fails(
        &|copy| copy.edit("meta/tasks.parquet", |bytes| bytes[..100].to_vec()),
        "nothing can be recovered without the tasks",
    );
    fails(
        &|copy| copy.edit(DATA, |bytes| bytes[..4].to_vec()),
        "episode 0: it has pictures and no rows",
    );
    fails(
        &|copy| {
            copy.edit(DATA, |mut bytes| {
                // The sizes of the first page follow its type. It claims 100 MB.
                assert_eq!(bytes[4..7], [0x15, 4, 0x15]);
                bytes.splice(7..9, [0x80, 0x84, 0xaf, 0x5f]);
                bytes
            })
        },
        "at most 8388608 are read of a page or file of this size",
    );
    fails(
        &|copy| copy.edit_text(INFO, "\"v3.0\"", "\"v2.1\""),
        "the format is v2.1; only v3.0 is recovered",
    );
    fails(
        &|copy| copy.edit_text(INFO, "\"dtype\": \"int64\"", "\"dtype\": \"string\""),
        "is \"string\"; only numbers, truth values and vectors",
    );
    fails(
        &|copy| copy.edit_text(INFO, "data/chunk-{", "rows/chunk-{"),
        "data_path is not \"data/chunk-{",
    );
    let edit_features = |copy: &Copy, change: &dyn Fn(&mut serde_json::Value)| {
        copy.edit(INFO, |bytes| {
            let mut info: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
            change(&mut info["features"]);
            info.to_string().into_bytes()
        })
    };
    fails(
        &|copy| {
            edit_features(copy, &|features| {
                features["observation.images.depth"] = serde_json::json!({
                    "dtype": "video",
                    "shape": [48, 64, 1],
                    "names": ["height", "width", "channels"],
                    "info": {"is_depth_map": true},
                });
            })
        },
        "\"observation.images.depth\" is a depth map; these are not recovered",
    );
    fails(
        &|copy| {
            edit_features(copy, &|features| {
                features["timestamp"]["shape"] = vec![70_000].into()
            })
        },
        "feature \"timestamp\" is \"float32\"; only numbers",
    );
    fails(
        &|copy| copy.edit_text(INFO, "                64,", "                63,"),
        "(height x width) cannot be encoded; both sides have to be even",
    );
}

#[test]
fn what_leads_nowhere_and_paths_that_are_not_named_do_no_harm() {
    let copy = copy_of("killed_in_batch");
    let path = "\"videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4\"";
    copy.edit_text(INFO, path, "null");
    let nowhere = copy.path("images/observation.images.top/episode-000000/frame-000999.png");
    std::os::unix::fs::symlink("nowhere", nowhere).unwrap();
    let report = recover(copy.root(), &Out::new().path()).unwrap();
    assert_eq!(report.saved[0].recorded_as, 0);
}

#[test]
fn videos_of_another_size_than_the_metadata_says_are_not_saved() {
    let copy = copy_of("killed_between_episodes");
    copy.edit_text(INFO, "                64,", "                66,");
    let error = recover(copy.root(), &Out::new().path()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("(height x width), meta/info.json states 66 x "),
        "{error}"
    );
}

#[test]
fn a_finished_table_with_empty_cells_is_refused() {
    let copy = copy_of("finished");
    copy.edit_rows(|rows| {
        let times: Float32Array = (0..rows.num_rows())
            .map(|row| (row != 2).then_some(row as f32 / 10.0))
            .collect();
        let mut columns = rows.columns().to_vec();
        columns[rows.schema().index_of("timestamp").unwrap()] = Arc::new(times);
        RecordBatch::try_new(rows.schema(), columns).unwrap()
    });
    let error = recover(copy.root(), &Out::new().path()).unwrap_err();
    assert!(error.to_string().contains("it has empty cells"), "{error}");
}

#[test]
fn the_new_folder_is_new_and_elsewhere() {
    let copy = copy_of("killed_between_episodes");
    let fails = |out: &Path, cause: &str| {
        let error = recover(copy.root(), out).unwrap_err().to_string();
        assert!(error.contains(cause), "{cause:?} is not in {error}");
    };
    let out = Out::new();
    fs::create_dir(out.path()).unwrap();
    fails(&out.path(), "is there already");
    fails(&copy.path("saved"), "lies in the recording");
    fails(&copy.path("meta/saved"), "lies in the recording");
    fails(
        &out.path().join("none/saved"),
        "no such folder; make it first",
    );
    let nowhere = copy.path("nowhere");
    assert!(matches!(
        recover(&nowhere, &out.path().join("x")),
        Err(DatasetError::NoFolder { path }) if path == nowhere
    ));
}
