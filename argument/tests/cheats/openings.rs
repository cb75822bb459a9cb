//! Cheats about what was committed to: the losses are those of other samples than the ones that the node's dataset holds.

use super::lies::party::Lie;
use super::lies::{refused, World};
use crate::models::{Models, BLIND};
use zk0_argument::expert::sample::prove::committed;
use zk0_argument::transcript::Refused;
use zk0_circuits::EvalSpec;

/// Tells of one sample, and commits to another one. If that is accepted, then for the digest of the one that was committed to.
fn told(lie: Lie) -> Result<(), Refused> {
    let spec = EvalSpec::micro();
    let tale = World::random(1, 41);
    let truth = World::of(Models {
        samples: Models::new(&spec, 1, 42).samples,
        ..Models::new(&spec, 1, 41)
    });
    let mut sample_values = tale.known.clone();
    sample_values.samples[0].data = truth.known.samples[0].data.clone();
    let prover = tale.prove(&sample_values, lie);
    let told = tale.verify([&tale.models.base, &tale.models.update], prover.words());
    if let Ok(verified) = &told {
        let (sample, _) = &truth.models.samples[0];
        assert_eq!(verified.samples, [committed(&spec, sample, &BLIND).0]);
    }
    tale.named(&prover, told.map(drop))
}

#[test]
fn claims_about_other_samples_are_refused() {
    assert_eq!(told(Lie::Claims), refused("the sumcheck of the claims"));
}

#[test]
fn the_value_of_other_samples_is_refused() {
    assert_eq!(told(Lie::Shared), refused("the columns of a commitment"));
}

/// The work is done before what it protects: any number in place of the prover's is refused.
#[test]
fn what_is_combined_without_work_is_refused() {
    let world = World::random(1, 43);
    let places = world.prove(&world.known, Lie::Nothing).places().to_vec();
    let masks = places.iter().filter(|place| place.is_none()).count();
    // Before the masks, two values of columns were stated, and after them two sums.
    let first_mask = places.len() - 2 - masks;
    let [sum, of_g, with_masks] =
        [first_mask - 2, first_mask - 1, first_mask + masks].map(|pad| places[pad].unwrap());
    let factors = with_masks + 4;
    for (place, what) in [
        (sum - 1, "the combination of columns"),
        (of_g + 2, "the sums of columns"),
        (factors + 2 * masks + 2, "the pads"),
    ] {
        let told = world.changed(|proof| proof[place] ^= 1);
        assert_eq!(told, Err(Refused::Work(what)));
    }
}
