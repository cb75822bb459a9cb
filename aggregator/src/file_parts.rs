//! A file in parts, for sending it over a network. Memory stays small whatever the size of the file, and a reader that takes no
//! part for too long, or too long for all, is given up.

use std::io::{self, ErrorKind};
use std::time::Duration;
use tokio::fs::File;
use tokio::io::AsyncReadExt;
use tokio::sync::mpsc;
use tokio::time::{timeout_at, Instant};
use tokio_stream::wrappers::ReceiverStream;

/// Bytes in a part.
const PART_BYTES: usize = 64 << 10;

/// How many parts wait for the reader.
const AHEAD: usize = 2;

/// How long a reader may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    /// For the next part.
    pub silence: Duration,
    /// For all parts.
    pub all: Duration,
}

/// The parts of `file`, in order. If the reader takes too long, the last one is an error of the kind `TimedOut`. `kept` is dropped when the
/// file is closed.
pub(crate) fn file_parts(
    mut file: File,
    pace: Pace,
    kept: impl Send + 'static,
) -> ReceiverStream<io::Result<Vec<u8>>> {
    let (sender, parts) = mpsc::channel(AHEAD + 1);
    let ends = Instant::now() + pace.all;
    tokio::spawn(async move {
        let _kept = kept;
        // A reader that takes nothing leaves no other room for the reason why it is given up.
        let Ok(reason) = sender.clone().reserve_owned().await else {
            return;
        };
        let given_up = loop {
            let mut part = vec![0; PART_BYTES];
            match file.read(&mut part).await {
                Ok(0) => return,
                Ok(read) => part.truncate(read),
                Err(error) => break error,
            }
            let next = ends.min(Instant::now() + pace.silence);
            let taken = timeout_at(next, sender.send(Ok(part))).await;
            if matches!(taken, Ok(Err(_))) {
                // The reader is gone.
                return;
            }
            if Instant::now() >= ends {
                break late("the file", pace.all);
            }
            if taken.is_err() {
                break late("its next part", pace.silence);
            }
        };
        reason.send(Err(given_up));
    });
    ReceiverStream::new(parts)
}

fn late(what: &str, limit: Duration) -> io::Error {
    let why = format!("taking {what} took more than {} ms", limit.as_millis());
    io::Error::new(ErrorKind::TimedOut, why)
}
