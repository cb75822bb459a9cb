//! A file in parts, for sending it over a network, in little memory. A reader too slow for one part, or for all, is given up.

use std::io::{self, ErrorKind};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::sync::mpsc;
use tokio::time::{timeout_at, Instant};
use tokio_stream::wrappers::ReceiverStream;

const PART_BYTES: usize = 64 << 10;

const AHEAD: usize = 2;

/// How long a reader may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReadingPace {
    /// For the next part.
    pub silence: Duration,
    /// For all parts.
    pub all: Duration,
}

/// A slower reader, in bytes per second, is given up: 8 Mbit/s.
const SLOWEST: u64 = 1_000_000;

impl ReadingPace {
    /// For an answer of `bytes`: `least`, and a slow line's time.
    pub fn of_bytes(bytes: u64, silence: Duration, least: Duration) -> Self {
        Self {
            silence,
            all: least.saturating_add(Duration::from_secs(bytes / SLOWEST)),
        }
    }
}

/// The parts of `file`, in order. If the reader takes too long, the last is an error of the kind `TimedOut`. `kept` is dropped with the
/// file.
pub(crate) fn file_parts(
    mut file: impl AsyncRead + Unpin + Send + 'static,
    pace: ReadingPace,
    kept: impl Send + 'static,
) -> ReceiverStream<io::Result<Vec<u8>>> {
    let (sender, parts) = mpsc::channel(AHEAD + 1);
    let ends = Instant::now() + pace.all;
    tokio::spawn(async move {
        let _kept = kept;
        // The reason needs a free place, which this reader never leaves.
        let Ok(reason) = sender.clone().reserve_owned().await else {
            return;
        };
        let given_up = loop {
            let mut part = vec![0; PART_BYTES];
            // A file that is being written may have no next bytes yet.
            let read = tokio::select! {
                read = file.read(&mut part) => read,
                () = sender.closed() => return,
            };
            match read {
                Ok(0) => return,
                Ok(read) => part.truncate(read),
                Err(error) => break error,
            }
            let next = ends.min(Instant::now() + pace.silence);
            let taken = timeout_at(next, sender.send(Ok(part))).await;
            if matches!(taken, Ok(Err(_))) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_file_has_the_time_that_a_slow_line_needs() {
        let [silence, least] = [20, 600].map(Duration::from_secs);
        let pace = |bytes| ReadingPace::of_bytes(bytes, silence, least).all;
        assert_eq!(pace(1000), least);
        // 1 GB takes 800 seconds at 10 Mbit/s. Every size has a bound.
        assert_eq!(pace(1_000_000_000), Duration::from_secs(1600));
    }
}
