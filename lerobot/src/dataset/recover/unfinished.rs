//! Tells a recording that ended too early from a damaged or partly copied one.

use std::path::Path;

use crate::dataset::recover::leftovers;
use crate::dataset::recover::source::data_files;
use crate::dataset::tables::whole_rows::lacks_footer;
use crate::dataset::{DatasetError, Info};

/// Replaces an error about `meta/episodes` if the recording ended too early.
pub(crate) fn explained(root: &Path, info: &Info, error: DatasetError) -> DatasetError {
    match sign(root, info) {
        Some(sign) => DatasetError::Unfinished {
            path: root.into(),
            sign,
        },
        None => error,
    }
}

fn sign(root: &Path, info: &Info) -> Option<String> {
    let data = data_files(root).unwrap_or_default();
    if let Some(path) = data.iter().find(|path| lacks_footer(path)) {
        return Some(format!("{} has no footer", path.display()));
    }
    let camera = info.cameras.iter().find(|camera| {
        let left = leftovers::episodes_with_pictures(root, &camera.name).unwrap_or_default();
        left.iter()
            .any(|&episode| episode < info.total_episodes as u64)
    })?;
    let pictures = root.join("images").join(&camera.name);
    Some(format!(
        "{} has pictures that were not encoded",
        pictures.display()
    ))
}
