//! Cheats about what an argument leaves to check: claims about tables, and claims that are not where the weights are.

use super::lies::party::Lie;
use super::lies::{refused, World};
use zk0_argument::expert::argument::verify;
use zk0_argument::expert::builder::{TABLES, WEIGHTS};
use zk0_argument::expert::published::Published;
use zk0_argument::field::Extension;
use zk0_argument::party::ValueClaim;
use zk0_argument::relation::ColumnSource;
use zk0_argument::transcript::Refused;

/// The table of powers has another row, at a distance that no score has in this evaluation. What is shown then is no longer the evaluation.
#[test]
fn an_argument_about_another_table_is_refused() {
    let mut world = World::random(1, 61);
    let relations = &world.expert.builder.relations;
    let counts = relations.tensors.iter();
    let counts = counts
        .filter(|tensor| tensor.name == "powers of two" && tensor.source != TABLES)
        .map(|tensor| tensor.offset);
    let counts = counts.max_by_key(|&offset| offset).unwrap();
    let powers = relations.tensors[world.expert.powers.tensor].clone();
    let rows = 0..1usize << powers.places[0].bits;
    let unused = rows
        .clone()
        .find(|row| world.known.samples[0].main[counts + row] == 0);
    world.known.common.tables[powers.offset + unused.unwrap()] += 1;
    assert_eq!(
        world.told(&world.known.clone(), Lie::Nothing),
        refused("a claim about a table")
    );
}

/// An honest argument's claims, of which one is changed.
fn told(source: ColumnSource, change: impl FnOnce(&mut ValueClaim)) -> Result<(), Refused> {
    let world = World::random(1, 62);
    let proof = world.prove(&world.known, Lie::Nothing);
    let mut published = verify(&world.statement, proof.words())?.published;
    let mut claims = published.claims.iter_mut();
    change(claims.find(|claim| claim.about.source == source).unwrap());
    world.check([&world.models.base, &world.models.update], &published)
}

#[test]
fn a_claim_about_no_weights_is_refused() {
    let told = told(WEIGHTS, |claim| {
        claim.about.offset += 1 << 40;
        claim.value = Extension::ZERO;
    });
    assert_eq!(told, refused("the place of a claim about weights"));
}

#[test]
fn a_claim_about_every_second_weight_is_refused() {
    let told = told(WEIGHTS, |claim| claim.about.parts[0].0 += 1);
    assert_eq!(told, refused("the place of a claim about weights"));
}

#[test]
fn a_claim_about_no_table_is_refused() {
    let told = told(TABLES, |claim| {
        claim.about.offset += 1 << 40;
        claim.value = Extension::ZERO;
    });
    assert_eq!(told, refused("the place of a claim about a table"));
}

#[test]
fn a_claim_about_another_source_is_refused() {
    let told = told(TABLES, |claim| claim.about.source = ColumnSource(9));
    assert_eq!(told, refused("the place of a claim about a table"));
}

#[test]
fn a_claim_about_every_second_row_is_refused() {
    let told = told(TABLES, |claim| claim.about.parts[0].0 = 1);
    assert_eq!(told, refused("the place of a claim about a table"));
}

/// Claims for which no value was computed would be skipped.
#[test]
fn values_that_are_missing_are_refused() {
    let world = World::random(1, 63);
    let proof = world.prove(&world.known, Lie::Nothing);
    let published = verify(&world.statement, proof.words()).unwrap().published;
    let told = published.check(&world.expert, [&[], &[]]);
    assert_eq!(told, refused("the number of claims about weights"));
}

#[test]
fn words_after_the_claims_are_refused() {
    let world = World::random(1, 64);
    let proof = world.prove(&world.known, Lie::Nothing);
    let mut words = verify(&world.statement, proof.words())
        .unwrap()
        .published
        .words();
    assert!(Published::from_words(&words).is_some());
    words.push(0);
    assert!(Published::from_words(&words).is_none());
}
