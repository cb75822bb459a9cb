//! How a private input travels to the proving service: mode, program and buffer sizes, then the bytes.

use crate::program::{elf_of, GuestInput};
use crate::rpc::prove_part::Part;
use crate::rpc::{prove_request, ProvePart, ProveRequest};
use std::sync::Arc;
use std::time::Duration;
use tokio_stream::{Stream, StreamExt};
use tonic::Status;
use zk0_circuits::Mode;

const CHUNK_BYTES: usize = 1 << 20;
/// Largest message: a chunk, and its encoding.
pub const MAX_MESSAGE_BYTES: usize = 2 * CHUNK_BYTES;
/// Largest event: a proof (1.3 MB) with its public values.
pub const MAX_EVENT_BYTES: usize = 8 << 20;
/// Most buffers. No program reads more than four.
const MAX_BUFFERS: usize = 16;
/// Largest input. At the published size, a claim takes 1 to 3 MB in mode `succinct`, and weights and samples in mode `direct`.
pub const MAX_INPUT_BYTES: u64 = 1 << 30;

/// A client's time to send its private input, which holds memory of the service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadTimeout {
    /// Longest silence.
    pub silence: Duration,
    /// Longest whole upload.
    pub whole: Duration,
}

impl Default for UploadTimeout {
    fn default() -> Self {
        Self {
            silence: Duration::from_secs(60),
            whole: Duration::from_secs(900),
        }
    }
}

/// A request's first message: its mode, program and buffer sizes.
pub struct Announced {
    mode: Mode,
    program: Vec<u8>,
    sizes: Vec<u64>,
}

/// The messages that carry `input`, each made when sent.
pub fn parts(input: impl Into<Arc<GuestInput>>) -> impl Iterator<Item = ProvePart> + Send {
    let input: Arc<GuestInput> = input.into();
    let mode = match input.mode {
        Mode::Direct => prove_request::Mode::Direct,
        Mode::Succinct => prove_request::Mode::Succinct,
    };
    let request = Part::Request(ProveRequest {
        mode: mode.into(),
        program: input.program.clone(),
        buffers: input.buffers.iter().map(|b| b.len() as u64).collect(),
    });
    let chunks = (0..input.buffers.len()).flat_map(move |number| {
        let input = input.clone();
        let starts = (0..input.buffers[number].len()).step_by(CHUNK_BYTES);
        starts.map(move |at| {
            let buffer = &input.buffers[number];
            buffer[at..buffer.len().min(at + CHUNK_BYTES)].to_vec()
        })
    });
    std::iter::once(request)
        .chain(chunks.map(Part::Data))
        .map(|part| ProvePart { part: Some(part) })
}

impl Announced {
    /// Reads the first message and checks its limits.
    pub async fn receive(
        parts: &mut (impl Stream<Item = Result<ProvePart, Status>> + Unpin),
    ) -> Result<Self, Status> {
        let Some(Part::Request(request)) = next(parts).await? else {
            return Err(Status::invalid_argument(
                "a request begins with its mode and the sizes of its buffers",
            ));
        };
        let mode = match request.mode() {
            prove_request::Mode::Direct => Mode::Direct,
            prove_request::Mode::Succinct => Mode::Succinct,
            prove_request::Mode::Unspecified => {
                return Err(Status::invalid_argument("the request names no known mode"));
            }
        };
        let announced = Self {
            mode,
            program: request.program,
            sizes: request.buffers,
        };
        let (buffers, bytes) = (announced.sizes.len(), announced.bytes());
        if buffers > MAX_BUFFERS || bytes > MAX_INPUT_BYTES {
            return Err(Status::out_of_range(format!(
                "a private input of {buffers} buffers and {bytes} bytes is too large: it may have at most {MAX_BUFFERS} buffers and \
                 {MAX_INPUT_BYTES} bytes"
            )));
        }
        // The node asks again meanwhile.
        elf_of(mode, &announced.program).map_err(|lacks| Status::unavailable(lacks.to_string()))?;
        Ok(announced)
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.sizes
            .iter()
            .fold(0, |sum, &size| sum.saturating_add(size))
    }

    /// Reads the buffers. Memory grows with received bytes, not with announced sizes.
    pub async fn rest(
        self,
        parts: &mut (impl Stream<Item = Result<ProvePart, Status>> + Unpin),
    ) -> Result<GuestInput, Status> {
        let mut buffers = Vec::with_capacity(self.sizes.len());
        let mut chunk = Vec::new();
        for size in self.sizes {
            let mut buffer = Vec::new();
            while (buffer.len() as u64) < size {
                if chunk.is_empty() {
                    chunk = match next(parts).await? {
                        Some(Part::Data(data)) => data,
                        _ => return Err(other_size("fewer")),
                    };
                }
                let missing = usize::try_from(size - buffer.len() as u64).unwrap_or(usize::MAX);
                buffer.extend(chunk.drain(..missing.min(chunk.len())));
            }
            buffers.push(buffer);
        }
        if !chunk.is_empty() || next(parts).await?.is_some() {
            return Err(other_size("more"));
        }
        Ok(GuestInput {
            mode: self.mode,
            program: self.program,
            buffers,
        })
    }
}

/// The same messages. A silence of this length is an error.
pub(super) fn in_time(
    parts: impl Stream<Item = Result<ProvePart, Status>>,
    silence: Duration,
) -> impl Stream<Item = Result<ProvePart, Status>> {
    let part = move |part: Result<_, _>| {
        part.unwrap_or_else(|_| Err(too_long("nothing of the private input came for", silence)))
    };
    parts.timeout(silence).map(part)
}

pub(super) fn too_long(what: &str, limit: Duration) -> Status {
    Status::deadline_exceeded(format!("{what} more than {} ms", limit.as_millis()))
}

async fn next(
    parts: &mut (impl Stream<Item = Result<ProvePart, Status>> + Unpin),
) -> Result<Option<Part>, Status> {
    Ok(parts.next().await.transpose()?.and_then(|part| part.part))
}

fn other_size(which: &str) -> Status {
    Status::invalid_argument(format!("{which} bytes came than the request announced"))
}
