//! Who sends a request, by its signed head, and which nodes show that they are present.

mod presence;
mod request_heads;
