//! Makes the new folder: writes it under another name, reads it once, then renames it.

use std::fs;
use std::path::{Path, PathBuf};

use zk0_files::atomic_file;
use zk0_files::random_number::random_number;

use crate::dataset::recover::folder::recording::Recording;
use crate::dataset::recover::folder::write::write;
use crate::dataset::recover::report::Recovered;
use crate::dataset::recover::{episodes, source};
use crate::dataset::{Dataset, DatasetError};

/// Writes what can be saved of the recording `from`, with its videos' right places, to the new folder `out`, which gets its name when
/// whole. `from` is only read.
///
/// # Errors
/// [`DatasetError`] states why nothing can be saved, or what cannot be read or written.
pub fn recover(from: &Path, out: &Path) -> Result<Recovered, DatasetError> {
    if !from.is_dir() {
        return Err(DatasetError::NoFolder { path: from.into() });
    }
    refuse_place(from, out)?;
    let source = source::Source::read(from)?;
    let (recording, mut report) = episodes::choose(from, source)?;
    let partial = beside(out)?;
    let made = fill(&recording, &partial).and_then(|notes| {
        let renamed = atomic_file::rename_folder(&partial, out);
        renamed.map_err(|e| DatasetError::write(out, e))?;
        Ok(notes)
    });
    if made.is_err() {
        // The rest has a temporary name, and the first error matters more.
        let _ = fs::remove_dir_all(&partial);
    }
    report.notes.extend(made?);
    Ok(report)
}

fn fill(recording: &Recording, partial: &Path) -> Result<Vec<String>, DatasetError> {
    fs::create_dir(partial).map_err(|e| DatasetError::write(partial, e))?;
    let notes = write(recording, partial)?;
    // What zk0 cannot read is not called saved.
    Dataset::open(partial)?;
    Ok(notes)
}

/// Refuses a new folder that exists or would lie in the recording.
fn refuse_place(from: &Path, out: &Path) -> Result<(), DatasetError> {
    let refused = |cause: &str| Err(DatasetError::meta(out, cause));
    if fs::symlink_metadata(out).is_ok() {
        return refused("is there already; name a new folder");
    }
    let parent = atomic_file::folder_of(out);
    let real = |path: &Path| fs::canonicalize(path).map_err(|e| DatasetError::io(path, e));
    if !parent.is_dir() {
        return Err(DatasetError::meta(parent, "no such folder; make it first"));
    }
    if real(parent)?.starts_with(real(from)?) {
        return refused("lies in the recording, which is left as it is; name a folder elsewhere");
    }
    Ok(())
}

/// A name beside `out` for the unfinished folder.
fn beside(out: &Path) -> Result<PathBuf, DatasetError> {
    let Some(name) = out.file_name().and_then(|name| name.to_str()) else {
        return Err(DatasetError::meta(out, "is not a name for a new folder"));
    };
    let number = random_number().map_err(|e| DatasetError::write(out, e))?;
    Ok(out.with_file_name(format!(".{name}.{number:016x}.partial")))
}
