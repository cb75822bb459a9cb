//! Cheats by name. Each tries to get a false claim accepted.
//!
//! A cheat plays a prover with its own code against its linked crate. The test `deletion` of `zk0-circuits` plays each against the real
//! crate, and against one without a check. It copies this folder and `claims`, so these use no other module.

mod losses;
mod samples;
mod specification;
mod verifier;

/// `Ok` if a false claim was accepted. Panics if the claim is true: nothing was cheated.
pub type Cheat = fn() -> Result<(), String>;

/// All cheats.
pub const CHEATS: &[(&str, Cheat)] = &[
    ("opens the helpful samples only", samples::fewer),
    ("opens a lucky sample instead", samples::lucky),
    ("invents a sample", samples::invented),
    ("opens one sample twice", samples::twice),
    ("hides more samples than it counts", samples::deeper),
    ("counts more samples than there are", samples::shallower),
    ("salts copies of a sample", samples::salted_copies),
    ("flags copies of a sample", samples::flagged_copies),
    ("pads copies of a sample", samples::padded_copies),
    ("masks frames of copies", samples::masked_copies),
    ("writes into the padding of copies", samples::written_copies),
    (
        "writes into unused dimensions of copies",
        samples::widened_copies,
    ),
    ("evaluates another update", losses::other_update),
    ("evaluates another base", losses::other_base),
    ("contributes what is worse", losses::worse),
    ("contributes the base itself", losses::same),
    ("improves less than it states", losses::less),
    ("improves by chance", losses::by_chance),
    ("wraps a norm", losses::wrapped_norm),
    ("wraps a velocity", losses::wrapped_velocity),
    ("wraps attention outputs", losses::wrapped_outputs),
    (
        "evaluates by another specification",
        specification::other_frequencies,
    ),
    ("misreads the cache", specification::misread_cache),
    ("wraps the noise", specification::wrapped_noise),
];

/// Tries one by name.
pub fn try_cheat(name: &str) -> Result<(), String> {
    let cheat = CHEATS.iter().find(|(other, _)| *other == name);
    let (_, cheat) = cheat.unwrap_or_else(|| panic!("there is no cheat '{name}'"));
    cheat()
}
