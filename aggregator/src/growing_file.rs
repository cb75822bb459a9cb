//! A file that is being written, as its readers see it: they wait for what is missing, and hear if it never comes.

use crate::line::WorkPermit;
use futures_core::future::BoxFuture;
use std::fs::File;
use std::io::{self, ErrorKind, SeekFrom};
use std::os::unix::fs::FileExt;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{ready, Context, Poll};
use tokio::io::{AsyncRead, AsyncSeek, ReadBuf};
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use zk0_ledger::blobs::BlobError;

#[derive(Clone, Default)]
pub(crate) struct FileProgress {
    /// The file and its final size in bytes. Absent until its first ones are there.
    pub file: Option<(Arc<File>, u64)>,
    /// How many bytes of it may be read.
    pub held: u64,
    /// Why no more will come.
    pub failed: Option<Arc<BlobError>>,
}

pub(crate) struct GrowingFile {
    file: Arc<File>,
    size: u64,
    at: u64,
    progress: watch::Receiver<FileProgress>,
    reading: Option<BoxFuture<'static, io::Result<Vec<u8>>>>,
    /// Kept until all of the file is there.
    place: Option<WorkPermit>,
}

impl GrowingFile {
    /// Reads a file of `size` bytes while it grows.
    pub fn new(
        (file, size): (Arc<File>, u64),
        progress: watch::Receiver<FileProgress>,
        place: Option<WorkPermit>,
    ) -> Self {
        Self {
            file,
            size,
            at: 0,
            progress,
            reading: None,
            place,
        }
    }

    /// Reads a file that is whole.
    pub fn whole(file: File) -> io::Result<Self> {
        let (held, file) = (file.metadata()?.len(), Arc::new(file));
        let whole = FileProgress {
            held,
            ..FileProgress::default()
        };
        let (_, progress) = watch::channel(whole);
        Ok(Self::new((file, held), progress, None))
    }

    /// How many bytes the file will have.
    pub fn size(&self) -> u64 {
        self.size
    }
}

impl AsyncRead for GrowingFile {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        if this.at >= this.size || buffer.remaining() == 0 {
            return Poll::Ready(Ok(()));
        }
        let (file, at, most) = (&this.file, this.at, buffer.remaining());
        let progress = &this.progress;
        let begin = || -> BoxFuture<'static, _> {
            Box::pin(next(file.clone(), at, most, progress.clone()))
        };
        let reading = this.reading.get_or_insert_with(begin);
        let read = ready!(reading.as_mut().poll(context));
        this.reading = None;
        let bytes = read?;
        // A reader may now want fewer.
        let taken = bytes.len().min(buffer.remaining());
        buffer.put_slice(&bytes[..taken]);
        this.at += taken as u64;
        if this.progress.borrow().held >= this.size {
            this.place = None;
        }
        Poll::Ready(Ok(()))
    }
}

impl AsyncSeek for GrowingFile {
    fn start_seek(self: Pin<&mut Self>, place: SeekFrom) -> io::Result<()> {
        let SeekFrom::Start(at) = place else {
            return Err(ErrorKind::Unsupported.into());
        };
        let this = self.get_mut();
        (this.at, this.reading) = (at, None);
        Ok(())
    }

    fn poll_complete(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<u64>> {
        Poll::Ready(Ok(self.at))
    }
}

/// The next bytes from `at` on, once there are some.
async fn next(
    file: Arc<File>,
    at: u64,
    most: usize,
    mut progress: watch::Receiver<FileProgress>,
) -> io::Result<Vec<u8>> {
    let more = |now: &FileProgress| now.failed.is_some() || now.held > at;
    let held = match progress.wait_for(more).await {
        Ok(now) => match &now.failed {
            Some(failed) => return Err(io::Error::other(failed.clone())),
            None => now.held,
        },
        Err(ended) => return Err(io::Error::other(ended)),
    };
    let length = usize::try_from(held - at).unwrap_or(usize::MAX).min(most);
    let read = spawn_blocking(move || {
        let mut bytes = vec![0; length];
        let read = file.read_at(&mut bytes, at)?;
        bytes.truncate(read);
        Ok(bytes)
    });
    read.await.map_err(io::Error::other)?
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::time::Duration;
    use tokio::io::{AsyncReadExt, AsyncSeekExt};
    use tokio::time::timeout;
    use zk0_circuits::Digest;

    fn written(bytes: &[u8]) -> Arc<File> {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        Arc::new(file)
    }

    #[tokio::test]
    async fn a_reader_waits_for_what_is_not_there_yet() {
        let file = written(b"0123456789");
        let (sender, progress) = watch::channel(FileProgress::default());
        let mut reader = GrowingFile::new((file, 10), progress, None);
        let mut part = [0; 4];
        let waits = timeout(Duration::from_millis(10), reader.read(&mut part)).await;
        assert!(waits.is_err());
        sender.send_modify(|now| now.held = 3);
        assert_eq!(reader.read(&mut part).await.unwrap(), 3);
        assert_eq!(&part[..3], b"012");
        reader.seek(SeekFrom::Start(5)).await.unwrap();
        sender.send_modify(|now| now.held = 10);
        let mut rest = Vec::new();
        reader.read_to_end(&mut rest).await.unwrap();
        assert_eq!(rest, b"56789");
    }

    #[tokio::test]
    async fn a_file_that_never_becomes_whole_has_no_end() {
        let (sender, progress) = watch::channel(FileProgress::default());
        let mut reader = GrowingFile::new((written(b"0123"), 10), progress.clone(), None);
        sender.send_modify(|now| {
            now.held = 4;
            now.failed = Some(Arc::new(BlobError::Missing(Digest([1; 32]))));
        });
        let mut rest = Vec::new();
        let error = reader.read_to_end(&mut rest).await.unwrap_err();
        assert!(error.to_string().contains("there is no blob"), "{error}");
        let mut reader = GrowingFile::new((written(b"0123"), 10), progress, None);
        drop(sender);
        assert!(reader.read_to_end(&mut rest).await.is_err());
    }
}
