//! The tests of the argument. Without the feature `prove`, those of the guest's arithmetic alone.

#[cfg(feature = "prove")]
mod agreement;
#[cfg(feature = "prove")]
mod cheats;
#[cfg(feature = "prove")]
mod claim;
#[cfg(feature = "prove")]
mod commitment;
#[cfg(feature = "prove")]
mod expert;
mod fields;
#[cfg(feature = "prove")]
mod fractions;
#[cfg(feature = "prove")]
mod hiding;
mod layout;
#[cfg(feature = "prove")]
mod models;
#[cfg(feature = "prove")]
mod protocol;
#[cfg(feature = "prove")]
mod unchanged;
