//! Proofs stay what they are, word by word: a faster prover says the same.

use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::fractions::{self, prove::Stored};
use zk0_argument::hash::{leaf, Digest};
use zk0_argument::sumcheck;
use zk0_argument::transcript::{Challenges, Pads, Prover};

const STATEMENT: Digest = Digest([5, 6, 7, 8]);

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

/// The digest of a proof, and of a last challenge, which everything said has an influence on.
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
            let leaves = Stored::new(numerators, denominators);
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
        1675712092804303718,
        7992700197365903951,
        530509306511308848,
        3510260606776645832,
    ],
    [
        6925028445490002391,
        6835328565266799243,
        4499946592116063072,
        1851633428741833670,
    ],
    [
        8356694182453566799,
        2162145198011008524,
        2708947260842882379,
        2210328266868689633,
    ],
    [
        6567193558869254705,
        8236670732194527836,
        8289206674030781585,
        7879417625119003801,
    ],
    [
        7515444496149447486,
        2769095192725614332,
        6649029823368968774,
        3863855612789844886,
    ],
    [
        3775480239217087430,
        8907676523284981626,
        347165266630931350,
        1870201431489661609,
    ],
    [
        4118870660723531927,
        7185414226868690856,
        6526974648080305870,
        5297790525748905229,
    ],
];
const PRODUCTS: [[u64; 4]; 4] = [
    [
        4911193619190165482,
        7434480616869701643,
        4586442878276932152,
        7105035468657148653,
    ],
    [
        1952018102192571876,
        7425177416242692978,
        2272783478243457053,
        1056236080218978493,
    ],
    [
        2088381687322037032,
        6933432724899779416,
        5344222684188929414,
        535138121404134421,
    ],
    [
        8634940786436586460,
        8395126502664738043,
        2590527388038490700,
        4271055624483400606,
    ],
];
