//! Proofs stay what they are, word by word: a faster prover states the same.

use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::fractions::{self, prove::StoredFractions};
use zk0_argument::hash::{leaf, SpongeDigest};
use zk0_argument::sumcheck;
use zk0_argument::transcript::{Challenges, Pads, Prover};

const STATEMENT: SpongeDigest = SpongeDigest([5, 6, 7, 8]);

/// Elements that look random.
struct Elements(u64);

impl Elements {
    fn next(&mut self) -> Goldilocks {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        Goldilocks::from_i64((self.0 >> 1) as i64)
    }

    fn base(&mut self, count: usize) -> Vec<Goldilocks> {
        (0..count).map(|_| self.next()).collect()
    }

    fn extension(&mut self, count: usize) -> Vec<Extension> {
        (0..count)
            .map(|_| Extension([self.next(), self.next()]))
            .collect()
    }
}

/// A prover whose pads look random.
fn prover() -> Prover {
    Prover::new(&STATEMENT, Pads::new(Elements(77).extension(1 << 10)))
}

/// The digest of a proof, and of a last challenge, which everything stated has an influence on.
fn digest(mut prover: Prover) -> [u64; 4] {
    let last = prover.challenge();
    let mut words = prover.finish().unwrap();
    words.extend(last.0.map(Goldilocks::value));
    leaf(Goldilocks::of_words(&words).unwrap()).0
}

/// A sum of fractions whose numerators are in the base field if `small`, and where the last ones are 0/1 if `padded`.
fn fractions(variables: usize, small: bool, padded: bool) -> [u64; 4] {
    let mut prover = prover();
    let mut elements = Elements(variables as u64);
    let mut numerators = elements.extension(1 << variables);
    let mut denominators = elements.extension(1 << variables);
    if small {
        for numerator in &mut numerators {
            numerator.0[1] = Goldilocks::ZERO;
        }
    }
    if padded {
        for index in (1 << variables) * 5 / 7..1 << variables {
            numerators[index] = Extension::ZERO;
            denominators[index] = Extension::ONE;
        }
    }
    fractions::prove::sum(&mut prover, numerators, denominators);
    digest(prover)
}

#[test]
fn sums_of_fractions() {
    let digests = [
        fractions(1, false, false),
        fractions(2, true, false),
        fractions(5, false, false),
        fractions(11, true, true),
        fractions(15, false, true),
        fractions(16, true, true),
        fractions(16, true, false),
    ];
    assert_eq!(digests, FRACTIONS);
}

/// Fractions that are left out at the end are 0/1, however many they are.
#[test]
fn what_is_left_out_is_0_over_1() {
    let cases =
        (1..=4).flat_map(|variables| (0..=1 << variables).map(move |used| (variables, used)));
    let tall = [0, 1, 2, 3, 1023, 1024, 1025, 2048, 4097, 5000, 8191].map(|used| (13, used));
    for (variables, used) in cases.chain(tall) {
        let mut elements = Elements(used as u64);
        let mut numerators = elements.base(used);
        let mut denominators = elements.extension(used);
        let prove = |numerators, denominators| {
            let mut prover = prover();
            let leaves = StoredFractions::new(numerators, denominators);
            let claim = fractions::prove::sum_of(&mut prover, variables, leaves);
            (claim, prover.finish().unwrap())
        };
        let short = prove(numerators.clone(), denominators.clone());
        numerators.resize(1 << variables, Goldilocks::ZERO);
        denominators.resize(1 << variables, Extension::ONE);
        assert!(
            prove(numerators, denominators) == short,
            "{variables} {used}"
        );
    }
}

#[test]
fn products() {
    let digests = [1, 2, 7, 14].map(|variables| {
        let mut prover = prover();
        let mut elements = Elements(variables);
        let a = elements.extension(1 << variables);
        let b = elements.extension(1 << variables);
        let (mut a, mut b) = (a, b);
        let say = Prover::send_secret;
        sumcheck::prove::products(&mut prover, say, &mut a, &mut b, variables as usize);
        digest(prover)
    });
    assert_eq!(digests, PRODUCTS);
}

const FRACTIONS: [[u64; 4]; 7] = [
    [
        5721823323584604229,
        6659562829651044615,
        43151756329814039,
        4896028809908810046,
    ],
    [
        420422774288411126,
        3692150967699394684,
        6119319693890467724,
        5934000045351778114,
    ],
    [
        8334692447572059061,
        9128045067820939668,
        5973812967796705162,
        1665464992444020857,
    ],
    [
        5588247143495651543,
        2768617433937610951,
        7082997515156270647,
        3799152072461168731,
    ],
    [
        5942376027021097049,
        4965917359677493562,
        5932320860990289175,
        8268633888475247428,
    ],
    [
        1341912096026708013,
        3913109630895865962,
        4782363260770085997,
        2407313528449555031,
    ],
    [
        3900217196311797426,
        5643070116022887639,
        8102141000317601138,
        3093339424609304209,
    ],
];
const PRODUCTS: [[u64; 4]; 4] = [
    [
        7760779925909461408,
        1503721137877234195,
        7913925171217759594,
        7140829729723916116,
    ],
    [
        8932267328189028099,
        3525587208612233216,
        5236073872794322748,
        7667266053182836206,
    ],
    [
        2885202435696747265,
        8523732229415653056,
        1854204337927149152,
        2510231930765961609,
    ],
    [
        7261458061252583729,
        4040737788138888572,
        1784105170516687869,
        1045851921621387663,
    ],
];
