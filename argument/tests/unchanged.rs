//! Proofs stay what they are, word by word: a faster prover says the same. The digests are of proofs by the first, plain prover.

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
        6398519541580189984,
        8444577898407366979,
        929595795242669630,
        4673564974484893560,
    ],
    [
        1591328918084121454,
        8041790513759560597,
        7920507095495953892,
        5776985825884433662,
    ],
    [
        2855461493077781883,
        4881084742287777955,
        5270240342438744401,
        4338282887312243546,
    ],
    [
        7438015934232845775,
        3017165490283733075,
        3523553593847130364,
        8951833184504515330,
    ],
    [
        4960493228765572403,
        2786677471944118506,
        3580597481169871218,
        8945150918975549480,
    ],
    [
        1999692239723725667,
        2109709274201663032,
        5846871274441699156,
        7620206632599616176,
    ],
    [
        3956980841004176707,
        5641515122865289594,
        7652331957072672056,
        2042238378606715070,
    ],
];
const PRODUCTS: [[u64; 4]; 4] = [
    [
        5295152184661337641,
        1182641129574924739,
        7645481086822510129,
        4966947399577800072,
    ],
    [
        8049211812265683327,
        4675432318855168444,
        1767515459995972298,
        3417417976667554121,
    ],
    [
        4278550528422817744,
        3381299547997348108,
        1269207423817326951,
        4330544812391752644,
    ],
    [
        4394903245295836410,
        934467442382989109,
        1954014210109961166,
        7975604603776463422,
    ],
];
