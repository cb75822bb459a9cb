//! Cheats of the argument: each is refused by one check, and succeeds without it. `tests/tests/deletions/argument.rs` removes the checks.
//!
//! - [`lies`]: the prover that cheats. [`lookups`], [`sums`], [`openings`]: what is argued. [`encoding`]: its words.
//! - [`published`]: what is left to check of weights and tables. [`claims`]: the claim. [`samples`]: the digest of a sample.

mod claims;
mod encoding;
mod lies;
mod lookups;
#[path = "../models/mod.rs"]
mod models;
mod openings;
mod published;
mod samples;
mod sums;

use lies::party::Lie;
use lies::World;
use zk0_argument::expert::argument::prove::prove;

/// The prover that cheats is the real one where it does not lie.
#[test]
fn without_a_lie_it_says_what_the_prover_says() {
    for samples in [1, 2] {
        let world = World::random(samples, 1);
        let honest = prove(&world.statement, &world.expert, &world.witness).unwrap();
        assert!(world.prove(&world.witness, Lie::Nothing) == honest);
        // Where both worlds are the same, a tale is the truth.
        assert!(world.prove(&world.witness, Lie::Rows) == honest);
        assert_eq!(world.told(&world.witness, Lie::Nothing), Ok(()));
    }
}
