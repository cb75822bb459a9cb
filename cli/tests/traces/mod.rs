//! Traces: services send their spans to a collector, which receives them here as any other collector does. A collector that is down or slow, and a
//! header that a stranger sends, do no harm.

mod collector;
mod lost;
mod round;
mod strangers;
mod tls;
mod witness;
