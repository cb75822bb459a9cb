//! Files of Git LFS that were not fetched: a clone then has a few lines of text where weights, videos or tables should be.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How each pointer begins (<https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md>).
const START: &[u8] = b"version https://git-lfs.github.com/spec/v";

/// What to tell of a file that could not be read as what it should be, if it is such a pointer.
pub(crate) fn explain(path: &Path) -> Option<String> {
    let mut start = [0; START.len()];
    File::open(path).ok()?.read_exact(&mut start).ok()?;
    (start == START).then(|| {
        "is a Git LFS pointer, and not the file itself: Git LFS has not fetched that yet. Run `git lfs install` once and `git lfs pull` in the \
         clone, or fetch the files with `hf download`"
            .into()
    })
}
