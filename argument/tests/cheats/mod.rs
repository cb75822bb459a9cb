//! Cheats of the argument: each is refused by one check, and succeeds without it. `testkit/tests/deletions/argument.rs` removes the checks.
//!
//! - [`lies`]: the prover that cheats. [`lookups`], [`sums`], [`openings`]: what is argued. [`encoding`]: its words.
//! - [`published`]: what is left to check of weights and tables. [`claims`]: the claim. [`samples`]: the digest of a sample.

mod claims;
mod encoding;
mod lies;
mod lookups;
mod openings;
mod published;
mod samples;
mod sums;

use lies::party::Lie;
use lies::{honest, World};

/// The prover that cheats is the real one where it does not lie.
#[test]
fn without_a_lie_it_says_what_the_prover_says() {
    for samples in [1, 2] {
        let world = World::random(samples, 1);
        let words = honest(&world.statement, &world.known).len();
        // Where both worlds are the same, a tale is the truth.
        for lie in [Lie::Nothing, Lie::Shared] {
            assert_eq!(world.prove(&world.known, lie).words().len(), words);
            assert_eq!(world.told(&world.known, lie), Ok(()));
        }
    }
}
