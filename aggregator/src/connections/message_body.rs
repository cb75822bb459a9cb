//! The messages in the body of a gRPC request. A body is an error if a message is late, or if there is no memory for it in time.
//!
//! A message begins with five bytes: whether it is compressed, and its length (32 bits, the most significant byte first). Whoever decodes
//! it makes room for that length at once, so the memory is reserved before these bytes are handed on.

use crate::connections::caller::Caller;
use crate::connections::message_memory::{MessageMemory, Reserved, SMALL_BYTES};
use axum::body::{Body, Bytes};
use http_body::{Frame, SizeHint};
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{ready, Context, Poll};
use std::time::Duration;
use tokio::time::{sleep, Instant, Sleep};
use tonic::Status;

const PREFIX_BYTES: usize = 5;

/// The memory that a request has reserved. It is given back when the last clone is dropped.
#[derive(Clone, Default)]
pub(super) struct Memory(Arc<Mutex<Option<(u64, Reserved)>>>);

impl Memory {
    /// How many bytes are reserved.
    fn bytes(&self) -> u64 {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.as_ref().map_or(0, |(bytes, _)| *bytes)
    }

    fn keep(&self, bytes: u64, reserved: Reserved) {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *held = Some((bytes, reserved));
    }
}

type Reserving = Pin<Box<dyn Future<Output = Option<Reserved>> + Send>>;

/// A body whose messages arrive in time, and have their memory reserved.
pub(super) struct MessageBody {
    body: Body,
    caller: Caller,
    memory: MessageMemory,
    held: Memory,
    /// How long one message may take, from when it is asked for.
    patience: Duration,
    late: Pin<Box<Sleep>>,
    /// The next message has not been asked for.
    between: bool,
    prefix: Vec<u8>,
    /// Bytes of the present message that are still to come.
    left: u64,
    /// What has come, and waits for this much memory.
    waiting: Option<(Bytes, u64, Reserving)>,
    ended: bool,
}

impl MessageBody {
    pub fn new(
        body: Body,
        caller: Caller,
        memory: MessageMemory,
        held: Memory,
        patience: Duration,
    ) -> Self {
        Self {
            body,
            caller,
            memory,
            held,
            patience,
            late: Box::pin(sleep(patience)),
            between: true,
            prefix: Vec::with_capacity(PREFIX_BYTES),
            left: 0,
            waiting: None,
            ended: false,
        }
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

    fn fails(&mut self, status: Status) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        self.ended = true;
        self.waiting = None;
        Poll::Ready(Some(Err(status)))
    }
}

impl http_body::Body for MessageBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let this = &mut *self;
        if this.ended {
            return Poll::Ready(None);
        }
        if std::mem::take(&mut this.between) {
            this.late.as_mut().reset(Instant::now() + this.patience);
        }
        if this.late.as_mut().poll(context).is_ready() {
            let limit = this.patience.as_millis();
            return this.fails(match this.waiting {
                Some(_) => Status::unavailable(
                    "the aggregator is receiving too many large messages: send this one again later",
                ),
                None => Status::deadline_exceeded(format!("a message took more than {limit} ms")),
            });
        }
        if this.waiting.is_none() {
            let frame = ready!(Pin::new(&mut this.body).poll_frame(context));
            let frame = match frame {
                Some(Ok(frame)) => frame,
                Some(Err(error)) => return this.fails(Status::cancelled(error.to_string())),
                None => return Poll::Ready(None),
            };
            let data = match frame.into_data() {
                Ok(data) => data,
                Err(frame) => return Poll::Ready(Some(Ok(frame))),
            };
            let largest = this.follow(&data);
            // Whoever decodes it refuses what is over its limit, and makes no room for it.
            let over = largest > this.memory.largest();
            if over || largest <= SMALL_BYTES.max(this.held.bytes()) {
                return Poll::Ready(Some(Ok(Frame::data(data))));
            }
            if this.held.bytes() > 0 {
                // It would hold some memory while it waits for more, and so would others.
                return this.fails(Status::resource_exhausted(
                    "the messages of a stream must not be larger than its first large one",
                ));
            }
            let reserving = this.memory.clone().reserve(this.caller.clone(), largest);
            this.waiting = Some((data, largest, Box::pin(reserving)));
        }
        let Some((data, bytes, reserving)) = &mut this.waiting else {
            return Poll::Pending;
        };
        let Some(reserved) = ready!(reserving.as_mut().poll(context)) else {
            return this.fails(Status::resource_exhausted("the message is too large"));
        };
        this.held.keep(*bytes, reserved);
        let data = std::mem::take(data);
        this.waiting = None;
        Poll::Ready(Some(Ok(Frame::data(data))))
    }

    fn is_end_stream(&self) -> bool {
        self.ended || (self.waiting.is_none() && self.body.is_end_stream())
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
