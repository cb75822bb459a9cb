//! Who sends a request, by its signed head, and which nodes show that they are present.

#[path = "../harness/mod.rs"]
mod harness;

mod presence;
mod request_heads;

type Test = Result<(), Box<dyn std::error::Error>>;
