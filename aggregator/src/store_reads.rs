//! Blobs read from their store for downloads. Readers begin with the first bytes, and several readers of one blob share its reading. It
//! stops when the last one has left.

use crate::growing_file::{FileProgress, GrowingFile};
use crate::line::WorkPermit;
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tracing::Span;
use zk0_circuits::Digest;
use zk0_ledger::blobs::take::ArrivingBlob;
use zk0_ledger::blobs::{BlobError, Blobs};

type Readings = HashMap<Digest, Weak<watch::Sender<FileProgress>>>;

/// The blobs that are being read. Clones share them.
#[derive(Clone, Default)]
pub(crate) struct StoreReads {
    readings: Arc<Mutex<Readings>>,
    /// How many bytes of blobs the folder may hold after a reading; `None` for no limit.
    pub cache_bytes: Option<u64>,
}

impl StoreReads {
    /// A reader of a blob that is not in the folder, once its first bytes are there. They are unverified, but the last one comes only if
    /// all are right. `place` is taken while this reader needs the store.
    pub async fn open(
        &self,
        blobs: &Blobs,
        blob: Digest,
        mut place: WorkPermit,
    ) -> Result<GrowingFile, Arc<BlobError>> {
        let mut again = true;
        loop {
            let (mut progress, kept) = self.follow(blobs, blob, place);
            let begun = |now: &FileProgress| now.failed.is_some() || now.file.is_some();
            let begun = progress.wait_for(begun).await.map(|now| now.clone());
            let begun = begun.map_err(|ended| {
                let path = blobs.path(&blob);
                let error = io::Error::other(ended);
                Arc::new(BlobError::Io { path, error })
            })?;
            match (begun.failed, begun.file, kept) {
                // That reading may have begun long ago. The store may answer now.
                (Some(_), _, Some(kept)) if again => (again, place) = (false, kept),
                (Some(failed), ..) => return Err(failed),
                (None, Some(file), kept) => return Ok(GrowingFile::new(file, progress, kept)),
                (None, None, _) => return Err(Arc::new(BlobError::Missing(blob))),
            }
        }
    }

    /// Follows the reading of a blob, and begins it if there is none. Its own reading takes the place, and otherwise gives it back.
    fn follow(
        &self,
        blobs: &Blobs,
        blob: Digest,
        place: WorkPermit,
    ) -> (watch::Receiver<FileProgress>, Option<WorkPermit>) {
        let mut readings = self.locked();
        if let Some(progress) = readings.get(&blob).and_then(Weak::upgrade) {
            return (progress.subscribe(), Some(place));
        }
        let (progress, follower) = watch::channel(FileProgress::default());
        let progress = Arc::new(progress);
        readings.insert(blob, Arc::downgrade(&progress));
        drop(readings);
        let (reads, blobs, span) = (self.clone(), blobs.clone(), Span::current());
        spawn_blocking(move || {
            span.in_scope(|| reads.read(&blobs, &blob, &progress));
            drop(place);
        });
        (follower, None)
    }

    /// Reads a blob, and tells how far it has come.
    fn read(&self, blobs: &Blobs, blob: &Digest, progress: &watch::Sender<FileProgress>) {
        let mut abandoned = false;
        let read = blobs.fetch_followed(blob, &mut |arriving| {
            abandoned = self.is_abandoned(blob, progress);
            if abandoned {
                let ArrivingBlob { held, size, .. } = arriving;
                return Err(BlobError::Incomplete { held, size });
            }
            came(progress, arriving)
        });
        if !abandoned {
            self.locked().remove(blob);
        }
        let begun = progress.borrow().file.is_some();
        let whole = read.and_then(|()| {
            if begun {
                Ok(None)
            } else {
                whole(blobs, blob).map(Some)
            }
        });
        self.shrink(blobs);
        progress.send_modify(|now| match whole {
            Ok(whole) => {
                now.file = now.file.take().or(whole);
                now.held = now.file.as_ref().map_or(0, |(_, size)| *size);
            }
            Err(error) => now.failed = Some(Arc::new(error)),
        });
    }

    /// Whether a reading has no followers. It then gets none.
    fn is_abandoned(&self, blob: &Digest, progress: &watch::Sender<FileProgress>) -> bool {
        if !progress.is_closed() {
            return false;
        }
        let mut readings = self.locked();
        // A follower may have come before this had the lock.
        let abandoned = progress.is_closed();
        if abandoned {
            readings.remove(blob);
        }
        abandoned
    }

    /// Keeps the folder small. Readers of a removed file have it open.
    fn shrink(&self, blobs: &Blobs) {
        let Some(limit) = self.cache_bytes else {
            return;
        };
        if let Err(error) = blobs.shrink(limit, &BTreeSet::new()) {
            tracing::error!("the blobs in the ledger's folder stay: {error}");
        }
    }

    fn locked(&self) -> MutexGuard<'_, Readings> {
        // A panic elsewhere leaves the map whole.
        self.readings.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Tells of a part that has come. The last byte waits until all are verified.
fn came(
    progress: &watch::Sender<FileProgress>,
    arriving: ArrivingBlob<'_>,
) -> Result<(), BlobError> {
    let ArrivingBlob { file, size, held } = arriving;
    let held = held.min(size.saturating_sub(1));
    if held == 0 {
        return Ok(());
    }
    let begun = progress.borrow().file.is_some();
    let opened = if begun {
        None
    } else {
        let opened = File::open(file).map_err(|error| BlobError::Io {
            path: file.into(),
            error,
        })?;
        Some((Arc::new(opened), size))
    };
    progress.send_modify(|now| {
        now.file = now.file.take().or(opened);
        now.held = held;
    });
    Ok(())
}

/// The file of a blob that another thread has read, or that has no part.
fn whole(blobs: &Blobs, blob: &Digest) -> Result<(Arc<File>, u64), BlobError> {
    let file = blobs.file(blob)?;
    let about = file.metadata().map_err(|error| BlobError::Io {
        path: blobs.path(blob),
        error,
    })?;
    Ok((Arc::new(file), about.len()))
}
