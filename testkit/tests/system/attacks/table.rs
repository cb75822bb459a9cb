//! All attacks, by the rows of the table.

use super::attack::Attack;
use super::scene::PROOF_OF_ANY_CLAIM;
use super::{edge, nodes, operators, proofs};

/// The attacks, row by row.
pub const ATTACKS: &[Attack] = &[
    nodes::picked_challenge::ATTACK,
    operators::picked_randomness::ATTACK,
    nodes::padded_dataset::ATTACK,
    nodes::stale_base::ATTACK,
    nodes::other_update::ATTACK,
    nodes::replayed_proof::ATTACK,
    nodes::copied_update::ATTACK,
    nodes::lazy_update::ATTACK,
    nodes::shared_recording::ATTACK,
    nodes::poisoned_update::ATTACK,
    nodes::back_door::ATTACK,
    proofs::wrapped_values::ATTACK,
    proofs::guessed_point::ATTACK,
    proofs::other_program::ATTACK,
    operators::worthless_program::ATTACK,
    operators::invented_contribution::ATTACK,
    operators::split_view::ATTACK,
    operators::disclosed_losses::ATTACK,
    edge::silent_uploads::ATTACK,
    edge::idle_crowd::ATTACK,
    edge::busy_crowd::ATTACK,
    edge::stolen_request::ATTACK,
    edge::changed_statement::ATTACK,
    edge::impostor::ATTACK,
];

#[test]
fn each_row_has_an_attack() {
    let mut numbers: Vec<_> = ATTACKS.iter().map(|attack| attack.number).collect();
    numbers.dedup();
    assert_eq!(numbers, (1..=17).collect::<Vec<_>>());
}

/// Where a source changes, the code that takes its check out has to change, too.
#[test]
fn every_defence_can_be_taken_out_of_the_sources() {
    let defences = ATTACKS.iter().map(|attack| attack.defence);
    let defences = defences.chain([PROOF_OF_ANY_CLAIM]);
    let wrong = defences.flat_map(|defence| {
        let wrong = defence.out.iter().filter_map(|change| change.fits().err());
        wrong.map(move |why| format!("{}: {why}", defence.check))
    });
    let wrong: Vec<_> = wrong.collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
