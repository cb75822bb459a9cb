//! The body of an answer. Its request is in progress until it is sent.

use axum::body::{Body, Bytes};
use axum::response::Response;
use http_body::{Frame, SizeHint};
use std::pin::Pin;
use std::task::{ready, Context, Poll};

struct AnswerBody<F> {
    body: Body,
    seen: F,
}

/// Keeps `kept` until `response` is sent, or fails.
pub(crate) fn keeping<T: Send + Unpin + 'static>(response: Response, kept: T) -> Response {
    watched(response, move |_| {
        let _kept = &kept;
    })
}

/// Hands each frame of `response` to `seen`, which is dropped when it is sent, or fails.
pub(crate) fn watched(
    response: Response,
    seen: impl FnMut(&Frame<Bytes>) + Send + Unpin + 'static,
) -> Response {
    response.map(|body| Body::new(AnswerBody { body, seen }))
}

impl<F: FnMut(&Frame<Bytes>) + Unpin> http_body::Body for AnswerBody<F> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        if let Some(Ok(frame)) = &frame {
            (self.seen)(frame);
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
