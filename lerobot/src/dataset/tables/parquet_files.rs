//! Which parquet files a folder has: like LeRobot, all in its subfolders, whatever their numbers.

use std::path::{Path, PathBuf};

use crate::dataset::DatasetError;

/// `*/*.parquet` under `folder` by name, as in LeRobot; without the hidden files of file managers.
pub(crate) fn parquet_files(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let list = |dir: &Path| -> Result<Vec<PathBuf>, DatasetError> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(dir).map_err(|e| DatasetError::io(dir, e))? {
            let entry = entry.map_err(|e| DatasetError::io(dir, e))?;
            if !entry.file_name().as_encoded_bytes().starts_with(b".") {
                found.push(entry.path());
            }
        }
        found.sort();
        Ok(found)
    };
    let mut files = Vec::new();
    for chunk in list(folder)?.into_iter().filter(|p| p.is_dir()) {
        files.extend(
            list(&chunk)?
                .into_iter()
                .filter(|p| p.extension().is_some_and(|e| e == "parquet")),
        );
    }
    Ok(files)
}
