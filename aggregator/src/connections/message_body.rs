//! The messages in the body of a gRPC request. A body fails if a message is late, or gets no memory in time.
//!
//! A message begins with five bytes: whether it is compressed, and its length (32 bits, the most significant byte first). The decoder makes
//! room for that length at once, so memory is reserved first.

use crate::connections::caller::CallerId;
use crate::connections::message_memory::{MessageMemory, Reserved, SMALL_BYTES};
use axum::body::{Body, BodyDataStream, Bytes};
use futures_util::stream::try_unfold;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::time::{timeout_at, Instant};
use tokio_stream::StreamExt;
use tonic::{Code, Status};
use zk0_protocol::rpc::federation::{turned_down::Remedy, TurnedDown};

const PREFIX_BYTES: usize = 5;

/// A request's memory, until the last clone is dropped.
pub(super) type Memory = Arc<OnceLock<Reserved>>;

struct Messages {
    data: BodyDataStream,
    caller: CallerId,
    memory: MessageMemory,
    held: Memory,
    /// For one message, once asked for.
    patience: Duration,
    late: Instant,
    between: bool,
    prefix: Vec<u8>,
    /// Bytes of the present message to come.
    left: u64,
}

/// The body of a request of `caller`, with messages in time and memory reserved. `held` lives until the answer.
pub(super) fn bounded(
    body: Body,
    caller: CallerId,
    memory: MessageMemory,
    held: Memory,
    patience: Duration,
) -> Body {
    let messages = Messages {
        data: body.into_data_stream(),
        caller,
        memory,
        held,
        patience,
        late: Instant::now(),
        between: true,
        prefix: Vec::with_capacity(PREFIX_BYTES),
        left: 0,
    };
    let data = try_unfold(messages, |mut messages| async move {
        let data = messages.next().await?;
        Ok::<_, Status>(data.map(|data| (data, messages)))
    });
    Body::from_stream(data)
}

fn too_large(why: &str) -> Status {
    let never = TurnedDown {
        remedy: Remedy::Never.into(),
        ..TurnedDown::default()
    };
    never.status(Code::ResourceExhausted, why)
}

impl Messages {
    /// The next bytes, with memory for the messages that begin in them.
    async fn next(&mut self) -> Result<Option<Bytes>, Status> {
        if std::mem::take(&mut self.between) {
            self.late = Instant::now() + self.patience;
        }
        let data = match timeout_at(self.late, self.data.next()).await {
            Ok(Some(data)) => data.map_err(|error| Status::cancelled(error.to_string()))?,
            Ok(None) => return Ok(None),
            Err(_) => {
                let limit = self.patience.as_millis();
                let why = format!("a message took more than {limit} ms");
                return Err(Status::deadline_exceeded(why));
            }
        };
        let largest = self.follow(&data);
        let held = self.held.get().map_or(0, |held| held.bytes);
        // The decoder refuses a message over its limit, without making room.
        let over = largest > self.memory.largest();
        if over || largest <= SMALL_BYTES.max(held) {
            return Ok(Some(data));
        }
        if held > 0 {
            // Requests that hold memory and wait for more could block each other.
            return Err(too_large(
                "the messages of a stream must not be larger than its first large one",
            ));
        }
        let reserved = timeout_at(self.late, self.memory.reserve(self.caller, largest)).await;
        let reserved = reserved.map_err(|_| {
            Status::unavailable(
                "the aggregator is receiving too many large messages: send this one again later",
            )
        })?;
        let reserved = reserved.ok_or_else(|| too_large("the message is too large"))?;
        let _ = self.held.set(reserved);
        Ok(Some(data))
    }

    /// Follows the messages in `data`. Returns the length of the largest that begins there.
    fn follow(&mut self, mut data: &[u8]) -> u64 {
        let mut largest = 0;
        while !data.is_empty() {
            if self.left > 0 {
                let taken = self.left.min(data.len() as u64);
                self.left -= taken;
                data = &data[taken as usize..];
                self.between |= self.left == 0;
                continue;
            }
            let taken = (PREFIX_BYTES - self.prefix.len()).min(data.len());
            self.prefix.extend_from_slice(&data[..taken]);
            data = &data[taken..];
            if let Ok([_, length @ ..]) = <[u8; PREFIX_BYTES]>::try_from(&self.prefix[..]) {
                self.left = u32::from_be_bytes(length).into();
                self.prefix.clear();
                largest = largest.max(self.left);
                self.between |= self.left == 0;
            }
        }
        largest
    }
}
