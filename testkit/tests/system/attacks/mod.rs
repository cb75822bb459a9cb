//! The attacks of the table in `docs/attacks.md`, in files of their own. Each attack is carried out against what it is aimed at: an aggregator
//! that serves on loopback, its witnesses, the guest program's code, or an auditor's replay. It is refused, for its own reason.
//!
//! `make attacks` also carries them out in a copy of the sources, without their defences, one at a time ([`counter`]): there each attack has to
//! succeed.
//!
//! - [`attack`]: what an attack is. [`table`]: all of them. [`scene`]: what several of them begin with.
//! - [`nodes`]: by nodes. [`proofs`]: about proofs. [`operators`]: by who runs the aggregator. [`edge`]: on the network.

mod attack;
mod counter;
mod edge;
mod nodes;
mod operators;
mod proofs;
mod scene;
mod table;
