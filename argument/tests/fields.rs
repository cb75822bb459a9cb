//! The field and its extension are those of `p3-goldilocks`.

use p3_field::extension::BinomialExtensionField;
use p3_field::{BasedVectorSpace, Field, PrimeCharacteristicRing, PrimeField64};
use proptest::prelude::*;
use zk0_argument::field::goldilocks::{Products, P};
use zk0_argument::field::{Extension, Goldilocks};

type Theirs = p3_goldilocks::Goldilocks;
type TheirExtension = BinomialExtensionField<Theirs, 2>;

fn theirs(element: Goldilocks) -> Theirs {
    Theirs::new(element.value())
}

fn their_extension(element: Extension) -> TheirExtension {
    TheirExtension::from_basis_coefficients_fn(|place| theirs(element.0[place]))
}

fn same(ours: Goldilocks, other: Theirs) -> bool {
    ours.value() == other.as_canonical_u64()
}

fn same_extension(ours: Extension, other: TheirExtension) -> bool {
    let coefficients: &[Theirs] = other.as_basis_coefficients_slice();
    ours.0
        .iter()
        .zip(coefficients)
        .all(|(&ours, &other)| same(ours, other))
}

/// Elements of all sizes, and often one of those where a carry is likely.
fn element() -> impl Strategy<Value = Goldilocks> {
    let edges = prop::sample::select(vec![
        0,
        1,
        0xffff_fffe,
        0xffff_ffff,
        1 << 32,
        (1 << 63) - 1,
        P - 0xffff_ffff,
        P - 2,
        P - 1,
    ]);
    prop_oneof![any::<u64>(), edges]
        .prop_map(|value| Goldilocks::from_canonical(value % P).unwrap())
}

fn extension() -> impl Strategy<Value = Extension> {
    [element(), element()].prop_map(Extension)
}

proptest! {
    #[test]
    fn sums_products_and_inverses_are_theirs(a in element(), b in element()) {
        prop_assert!(same(a + b, theirs(a) + theirs(b)));
        prop_assert!(same(a - b, theirs(a) - theirs(b)));
        prop_assert!(same(a * b, theirs(a) * theirs(b)));
        prop_assert!(same(-a, -theirs(a)));
        prop_assert!(same(a.halved(), theirs(a).halve()));
        if a != Goldilocks::ZERO {
            prop_assert!(same(a.inverse(), theirs(a).inverse()));
        }
    }

    #[test]
    fn so_are_those_of_the_extension(a in extension(), b in extension()) {
        prop_assert!(same_extension(a + b, their_extension(a) + their_extension(b)));
        prop_assert!(same_extension(a - b, their_extension(a) - their_extension(b)));
        prop_assert!(same_extension(a * b, their_extension(a) * their_extension(b)));
        if a != Extension::ZERO {
            prop_assert_eq!(a * a.inverse(), Extension::ONE);
        }
    }

    #[test]
    fn a_sum_of_products_is_reduced_once(pairs in prop::collection::vec((element(), element()), 0..40)) {
        let mut products = Products::default();
        let mut expected = Goldilocks::ZERO;
        for &(a, b) in &pairs {
            products.add(a, b);
            expected += a * b;
        }
        prop_assert_eq!(products.reduce(), expected);
        let (weights, values): (Vec<_>, Vec<_>) = pairs.iter().map(|&(a, b)| (Extension([a, b]), b)).unzip();
        let expected: Extension = weights.iter().zip(&values).map(|(weight, &value)| weight.scale(value)).sum();
        prop_assert_eq!(Extension::dot(&weights, &values), expected);
    }

    #[test]
    fn integers_keep_their_value(value: i64) {
        let element = Goldilocks::from_i64(value);
        prop_assert_eq!(element.value() as i128, (value as i128).rem_euclid(P as i128));
    }
}

#[test]
fn only_values_below_the_modulus_are_canonical() {
    assert_eq!(Goldilocks::from_canonical(P), None);
    assert_eq!(Goldilocks::from_canonical(u64::MAX), None);
    assert_eq!(Goldilocks::of_words(&[0, P - 1, P]), Err(2));
    assert_eq!(
        Goldilocks::of_words(&[0, P - 1]).unwrap()[1],
        -Goldilocks::ONE
    );
}

#[test]
fn roots_of_unity_have_their_order() {
    for bits in 1..=32 {
        let root = Goldilocks::root_of_unity(bits);
        assert_eq!(root.pow(1 << (bits - 1)), -Goldilocks::ONE, "{bits}");
    }
    // Transforms use theirs.
    use p3_field::TwoAdicField;
    assert!(same(
        Goldilocks::root_of_unity(20),
        Theirs::two_adic_generator(20)
    ));
}
