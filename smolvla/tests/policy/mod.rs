//! The policy: its weights, its profiles, and what it does.

mod acting;
mod folder;
mod profiles;
mod trainable;
mod weights;
