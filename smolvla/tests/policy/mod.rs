//! The policy: its weights, its profiles, and what it does.

mod acting;
mod folder;
mod processors;
mod profiles;
mod trainable;
mod weights;
