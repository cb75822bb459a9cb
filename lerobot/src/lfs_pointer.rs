//! Files that Git LFS did not fetch: a clone has a few lines of text in place of weights, videos or tables.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How pointers begin (<https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md>).
const START: &[u8] = b"version https://git-lfs.github.com/spec/v";

/// What to report of an unreadable file, if it is a pointer.
pub(crate) fn explain(path: &Path) -> Option<String> {
    let mut start = [0; START.len()];
    File::open(path).ok()?.read_exact(&mut start).ok()?;
    (start == START).then(|| {
        "is a Git LFS pointer, and not the file itself: Git LFS has not fetched that yet. Run `git lfs install` once and `git lfs pull` in the \
         clone, or fetch the files with `hf download`"
            .into()
    })
}
