//! Shared by tests and benches of several crates. Nothing here is part of `zk0`.
//!
//! - Watching: [`allocations`] counts memory, [`fuzzing`] reads inputs that fuzzing found, [`own_process`] runs a test alone, and
//!   [`skipped`] reports tests that cannot run here.
//! - Waiting: [`until`] something has happened.
//! - Test subjects: [`claims`] and [`cheats`], a [`network`]'s history, its [`ledgers`] on disk, an [`aggregator`] and [`sockets`] that
//!   pester it, [`members`], an [`s3`] server, a [`local_hub`], [`recordings`] and [`made_recording`]s, their [`micro_network`],
//!   [`weight_claims`], [`event_files`], and a test's [`own_port`].
//! - [`changed_copy`]: the sources with changed code. [`pages`]: the commands of our pages.
//!
//! Modules that need our other crates are behind features of their names.

#[cfg(feature = "aggregator")]
pub mod aggregator;
pub mod allocations;
pub mod changed_copy;
#[cfg(feature = "claims")]
pub mod cheats;
#[cfg(feature = "claims")]
pub mod claims;
#[cfg(feature = "event_files")]
pub mod event_files;
pub mod fuzzing;
#[cfg(feature = "ledgers")]
pub mod ledgers;
#[cfg(feature = "local_hub")]
pub mod local_hub;
#[cfg(feature = "made_recording")]
pub mod made_recording;
#[cfg(feature = "members")]
pub mod members;
#[cfg(feature = "micro_network")]
pub mod micro_network;
#[cfg(feature = "network")]
pub mod network;
pub mod own_port;
pub mod own_process;
pub mod pages;
#[cfg(feature = "recordings")]
pub mod recordings;
#[cfg(feature = "s3")]
pub mod s3;
pub mod skipped;
#[cfg(feature = "aggregator")]
pub mod sockets;
mod waiting;
#[cfg(feature = "weight_claims")]
pub mod weight_claims;

pub use self::waiting::until;
#[cfg(feature = "until_async")]
pub use self::waiting::until_async;
