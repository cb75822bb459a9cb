//! A file in parts, for sending it over a network. Memory stays small whatever the size of the file, and a reader that takes no
//! part for too long is given up.

use std::io;
use std::time::Duration;
use tokio::fs::File;
use tokio::io::AsyncReadExt;
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;

/// Bytes in a part.
const PART_BYTES: usize = 64 << 10;

/// The parts of `file`, in order. They end early when the reader takes none for longer than `silence`.
pub(crate) fn file_parts(mut file: File, silence: Duration) -> ReceiverStream<io::Result<Vec<u8>>> {
    let (sender, parts) = mpsc::channel(2);
    tokio::spawn(async move {
        loop {
            let mut part = vec![0; PART_BYTES];
            let read = match file.read(&mut part).await {
                Ok(0) => return,
                Ok(read) => {
                    part.truncate(read);
                    Ok(part)
                }
                Err(error) => Err(error),
            };
            let failed = read.is_err();
            match timeout(silence, sender.send(read)).await {
                Ok(Ok(())) if !failed => {}
                _ => return,
            }
        }
    });
    ReceiverStream::new(parts)
}
