//! Every kind of message depends on a sample: without its pads, it would tell samples apart.

use super::made::{alike, Blinding, Made};
use std::collections::BTreeMap;
use zk0_argument::expert::argument::argued;
use zk0_argument::field::Extension;
use zk0_argument::fractions::LeafClaim;
use zk0_argument::layout::LookupLayout;
use zk0_argument::party::{Fold, Party, Sources, Sum, ValueClaim, Weighted};
use zk0_argument::prove::Proving;
use zk0_argument::relation::{Parts, Relations};
use zk0_argument::sumcheck::JoinedPoint;
use zk0_argument::transcript::{Challenges, Refused};

/// A prover that notes for each pad what kind of message it is used in.
struct Noting<'a, 'p> {
    proving: &'a mut Proving<'p>,
    kinds: Vec<&'static str>,
}

impl Challenges for Noting<'_, '_> {
    fn challenge(&mut self) -> Extension {
        self.proving.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.proving.positions(count, bits)
    }
}

macro_rules! noting {
    ($($name:ident($($argument:ident: $type:ty),*) -> $result:ty;)*) => {
        $(fn $name(&mut self, $($argument: $type),*) -> $result {
            let result = self.proving.$name($($argument),*);
            self.kinds.resize(self.proving.prover.secrets().len(), stringify!($name));
            result
        })*
    };
}

#[rustfmt::skip]
impl Party for Noting<'_, '_> {
    type Value = Extension;

    noting! {
        published(parts: &Parts, about: &Weighted) -> Result<Extension, Refused>;
        value(parts: &Parts, about: &Weighted) -> Result<Extension, Refused>;
        nothing(about: &Weighted) -> Extension;
        product(a: &Extension, b: &Extension) -> Result<Extension, Refused>;
        zero(what: &'static str, value: Extension) -> Result<(), Refused>;
        sum(relations: &Relations, parts: &Parts, sum: &Sum) -> Result<Extension, Refused>;
        work(bits: u32, what: &'static str) -> Result<(), Refused>;
        fractions(instance: usize, layout: &LookupLayout, fold: &Fold) -> Result<LeafClaim, Refused>;
        gather(layout: &LookupLayout, fold: &Fold, claims: &[LeafClaim], gamma: Extension) -> Result<(Vec<Extension>, Extension), Refused>;
        gathered(count: usize) -> Result<Vec<[Extension; 2]>, Refused>;
        reduce(relations: &Relations, parts: &Parts, sums: &[(Sum, Extension)], gamma: Extension, degree: usize)
            -> Result<(JoinedPoint, Extension), Refused>;
        reduce_claims(parts: &Parts, sources: &Sources<'_>, claims: &[ValueClaim<Extension>], gamma: Extension)
            -> Result<(JoinedPoint, Extension), Refused>;
    }
}

/// All secret values of an argument, and the kinds of those that are stated before its end.
fn secrets(made: &Made) -> (Vec<Extension>, Vec<&'static str>) {
    let samples = made.witnesses.len() as u64;
    let mut kinds = vec![];
    let prover = made.argue_by(
        &Blinding::of(4 << 8, samples),
        true,
        |proving, expert, shape| {
            let mut noting = Noting {
                proving,
                kinds: vec![],
            };
            let left = argued(&mut noting, expert, shape);
            kinds = noting.kinds;
            left
        },
    );
    (prover.secrets().to_vec(), kinds)
}

#[test]
fn every_kind_of_message_would_show_a_sample_without_its_pads() {
    let [(first, kinds), (second, _)] = alike(2, 73).map(|models| secrets(&Made::new(&models)));
    assert_eq!(first.len(), second.len());
    let mut tells = BTreeMap::new();
    for (number, (a, b)) in first.iter().zip(&second).enumerate() {
        let kind = kinds.get(number).unwrap_or(&"the end");
        // Coefficient by coefficient, so that masks of the base field would not be enough.
        let told: &mut [bool; 2] = tells.entry(*kind).or_default();
        for (told, part) in told.iter_mut().zip([0, 1]) {
            *told |= a.0[part] != b.0[part];
        }
    }
    let kinds = [
        "fractions",
        "gather",
        "gathered",
        "reduce",
        "reduce_claims",
        "sum",
        "the end",
        "value",
    ];
    assert_eq!(tells, kinds.map(|kind| (kind, [true; 2])).into());
}
