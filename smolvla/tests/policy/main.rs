//! The policy: its weights, its profiles, and what it does.

#[path = "../actor/mod.rs"]
mod actor;
#[path = "../reference/mod.rs"]
mod reference;

mod acting;
mod folder;
mod profiles;
mod trainable;
mod weights;
