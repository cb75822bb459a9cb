//! A small statement that uses every kind of relation: what holds is accepted, and what is changed is refused.

use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::hash::SpongeDigest;
use zk0_argument::multilinear::{eq_table, evaluate};
use zk0_argument::party::Sources;
use zk0_argument::protocol::argue;
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{count, Computed, Instance, NotInTable, Proving, SourceValues, Tables};
use zk0_argument::relation::public::{Affine, Public, RangeColumn, Ranges, Written};
use zk0_argument::relation::*;
use zk0_argument::share::share;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused, Verifier};
use zk0_argument::verify::Verifying;

const STATEMENT: SpongeDigest = SpongeDigest([1, 2, 3, 4]);
const MAIN: ColumnSource = ColumnSource(0);
const WEIGHTS: ColumnSource = ColumnSource(1);
/// Binary logarithm of the values of each source.
const BITS: [usize; 2] = [12, 7];
const SOURCES: Sources = Sources {
    all: &[(MAIN, BITS[0]), (WEIGHTS, BITS[1])],
    instances: 0,
};

const ROW: Axis = Axis(0);
const LAYER: Axis = Axis(1);
const IN: Axis = Axis(2);
const OUT: Axis = Axis(3);
const RANGE: Axis = Axis(4);
/// Half as many layers.
const PAIR: u8 = 1;

/// Where the tensors are in the main source.
const X: usize = 0; // [row, layer, in]
const Y: usize = 1 << 7; // [row, layer, out], (Σ x·w·scale(layer) + 8) >> 4
const SQUARE: usize = 2 << 7; // [row, layer, out], (y·y' + 16) >> 5, where y' is y at the other half of the outputs
const CHOSEN: usize = 3 << 7; // [row, layer, out], 1 at the chosen output, and 0 elsewhere
const LARGEST: usize = 4 << 7; // [row, layer]
const SHIFTED: usize = 5 << 7; // [row, pair], the largest of every second layer
const COUNTS: usize = 2 << 9; // [range]

fn term(factor: i64, atom: Atom) -> Term {
    Term {
        factor,
        coefficients: None,
        atom,
    }
}

fn with(number: usize, term: Term) -> Term {
    Term {
        coefficients: Some(number),
        ..term
    }
}

fn tensor(source: ColumnSource, offset: usize, axes: &[u8]) -> Tensor {
    Tensor::packed("a tensor", source, offset, axes)
}

fn view(tensor: usize, indices: &[Index]) -> Virtual {
    Virtual {
        views: vec![View {
            tensor,
            indices: indices.to_vec(),
            only: vec![],
            factor: 1,
        }],
    }
}

fn range(name: &'static str, axes: &[Axis], value: LinearSum, bits: i64, count: Count) -> Lookup {
    Lookup {
        name,
        axes: axes.to_vec(),
        count,
        entry: [value, vec![term(bits, Atom::One)], vec![], vec![]],
    }
}

fn relations() -> Relations {
    use Index::{Fixed, Mapped, Of};
    let mut r = Relations {
        axes: vec![2, 2, 3, 3, 9],
        tensors: vec![
            tensor(MAIN, X, &[2, 2, 3]),
            tensor(MAIN, Y, &[2, 2, 3]),
            tensor(MAIN, SQUARE, &[2, 2, 3]),
            tensor(MAIN, CHOSEN, &[2, 2, 3]),
            tensor(MAIN, LARGEST, &[2, 2]),
            tensor(MAIN, SHIFTED, &[2, PAIR]),
            tensor(MAIN, COUNTS, &[9]),
            // Weights of two models, of which one is used
            tensor(WEIGHTS, 0, &[3, 3, 1]),
        ],
        ..Default::default()
    };
    let swapped = (0..8).map(|index| Some((index + 4) % 8)).collect();
    let every_second = vec![Some(0), None, Some(1), None];
    r.maps = vec![swapped, every_second];
    let scales = [1, 2, 1, 3].map(Goldilocks::from_u32);
    r.coefficients = vec![(LAYER, scales.to_vec())];
    let own = [Of(ROW), Of(LAYER), Of(OUT)];
    r.virtuals = vec![
        view(0, &[Of(ROW), Of(LAYER), Of(IN)]),
        view(7, &[Of(IN), Of(OUT), Fixed(1)]),
        view(1, &own),
        view(1, &[Of(ROW), Of(LAYER), Mapped(OUT, 0)]),
        view(2, &own),
        view(3, &own),
        view(4, &[Of(ROW), Of(LAYER)]),
        // The shifted tensor at every second layer, less the largest there
        Virtual {
            views: vec![
                View {
                    tensor: 5,
                    indices: vec![Of(ROW), Mapped(LAYER, 1)],
                    only: vec![],
                    factor: 1,
                },
                View {
                    tensor: 4,
                    indices: vec![Of(ROW), Fixed(0)],
                    only: vec![(LAYER, 0)],
                    factor: -1,
                },
                View {
                    tensor: 4,
                    indices: vec![Of(ROW), Fixed(2)],
                    only: vec![(LAYER, 2)],
                    factor: -1,
                },
            ],
        },
        view(6, &[Of(RANGE)]),
    ];
    r.products = vec![Product {
        left: 0,
        right: 1,
        left_axes: vec![ROW, LAYER],
        right_axes: vec![OUT],
        shared: vec![],
        summed: vec![IN],
    }];
    let axes = vec![ROW, LAYER, OUT];
    let monomials = |summed, terms| Monomials {
        axes: vec![ROW, LAYER, OUT],
        summed,
        terms,
    };
    r.monomials = vec![
        monomials(0, vec![(1, vec![Factor::Virtual(2), Factor::Virtual(3)])]),
        // The chosen value, and whether exactly one is chosen
        monomials(1, vec![(1, vec![Factor::Virtual(5), Factor::Virtual(2)])]),
        monomials(1, vec![(1, vec![Factor::Virtual(5)])]),
        monomials(
            0,
            vec![
                (1, vec![Factor::Virtual(5), Factor::Virtual(5)]),
                (-1, vec![Factor::Virtual(5)]),
            ],
        ),
        // x·w·w of the product is no relation, but shows products and public factors in monomials
        monomials(
            0,
            vec![(
                1,
                vec![Factor::Product(0), Factor::Public(2), Factor::Virtual(2)],
            )],
        ),
        monomials(
            0,
            vec![(
                1,
                vec![Factor::Virtual(2), Factor::Product(0), Factor::Public(2)],
            )],
        ),
    ];
    r.sums = vec![Summed {
        of: 5,
        axes: vec![OUT],
    }];
    let written = Written {
        axes: vec![ROW],
        bits: vec![2],
        values: [1, 1, 1, 0].map(Goldilocks::from_u32).to_vec(),
    };
    let ranges = |column| Ranges {
        axis: [RANGE],
        column,
    };
    r.publics = vec![
        Box::new(ranges(RangeColumn::Value)) as Box<dyn Public>,
        Box::new(ranges(RangeColumn::Bits)),
        Box::new(written),
        Box::new(Affine {
            axis: [RANGE],
            start: -3,
        }),
    ];
    let remainder = vec![
        with(0, term(1, Atom::Product(0))),
        term(8, Atom::One),
        term(-16, Atom::Virtual(2)),
    ];
    let squared = vec![
        term(1, Atom::Monomials(0)),
        term(16, Atom::One),
        term(-32, Atom::Virtual(4)),
    ];
    let below = vec![term(1, Atom::Virtual(6)), term(-1, Atom::Virtual(2))];
    r.lookups = vec![
        range("the rest of y", &axes, remainder, 4, Count::Masked(2)),
        range(
            "y",
            &axes,
            vec![term(1, Atom::Virtual(2)), term(128, Atom::One)],
            8,
            Count::Each,
        ),
        range("the rest of a square", &axes, squared, 5, Count::Each),
        range("below the largest", &axes, below, 8, Count::Each),
        Lookup {
            name: "ranges",
            axes: vec![RANGE],
            count: Count::Offered(8),
            entry: [
                vec![term(1, Atom::Public(0))],
                vec![term(1, Atom::Public(1))],
                vec![],
                vec![],
            ],
        },
    ];
    let equality = |name, axes: &[Axis], linear| Equality {
        name,
        axes: axes.to_vec(),
        linear,
    };
    r.equalities = vec![
        equality(
            "the largest is the chosen one",
            &[ROW, LAYER],
            vec![term(1, Atom::Monomials(1)), term(-1, Atom::Virtual(6))],
        ),
        equality(
            "one is chosen",
            &[ROW, LAYER],
            vec![term(1, Atom::Summed(0)), term(-1, Atom::One)],
        ),
        equality(
            "it is chosen or not",
            &axes,
            vec![term(1, Atom::Monomials(3))],
        ),
        equality(
            "every second layer",
            &[ROW, LAYER],
            vec![term(1, Atom::Virtual(7))],
        ),
        equality(
            "factors commute",
            &axes,
            vec![term(1, Atom::Monomials(4)), term(-1, Atom::Monomials(5))],
        ),
    ];
    r
}

/// The values of both sources, but for the counts.
fn values(seed: u64) -> [Vec<i64>; 2] {
    let mut state = seed;
    let mut small = |bound: i64| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as i64 % (2 * bound + 1) - bound
    };
    let mut main = vec![0i64; 1 << BITS[0]];
    let weights: Vec<i64> = (0..1 << BITS[1]).map(|_| small(7)).collect();
    for row in 0..4 {
        for layer in 0..4 {
            let at = |tensor: usize, last: usize| tensor + row + 4 * layer + 16 * last;
            for last in 0..8 {
                main[at(X, last)] = small(9);
            }
            for out in 0..8 {
                let products = (0..8).map(|i| main[at(X, i)] * weights[64 + i + 8 * out]);
                main[at(Y, out)] = (products.sum::<i64>() * [1, 2, 1, 3][layer] + 8) >> 4;
            }
            let y: Vec<i64> = (0..8).map(|out| main[at(Y, out)]).collect();
            for out in 0..8 {
                main[at(SQUARE, out)] = (y[out] * y[(out + 4) % 8] + 16) >> 5;
            }
            let chosen = (0..8).max_by_key(|&out| y[out]).unwrap();
            main[at(CHOSEN, chosen)] = 1;
            main[at(LARGEST, 0)] = y[chosen];
            if layer % 2 == 0 {
                main[SHIFTED + row + 2 * layer] = y[chosen];
            }
        }
    }
    [main, weights]
}

fn fill_counts(values: &mut [Vec<i64>; 2]) -> Result<(), NotInTable> {
    let relations = relations();
    let sources = [
        SourceValues::Wide(&values[0]),
        SourceValues::Wide(&values[1]),
    ];
    let tables = Tables {
        relations: &relations,
        sources: &sources,
        computed: &Computed::default(),
    };
    let counts = count(&tables)?;
    values[0][COUNTS..COUNTS + (1 << 9)].copy_from_slice(&counts[0].1);
    Ok(())
}

/// An argument and its pads.
fn prove(values: &[Vec<i64>; 2]) -> (Vec<u64>, Vec<Extension>) {
    let relations = relations();
    let instance = Instance {
        relations: &relations,
        sources: vec![
            SourceValues::Wide(&values[0]),
            SourceValues::Wide(&values[1]),
        ],
    };
    let pads = (0..1i64 << 10).map(|seed| {
        let element = |factor| Goldilocks::from_i64(seed * factor + 3);
        Extension([element(1 << 41), element(-977)])
    });
    let pads: Vec<Extension> = pads.collect();
    let prover = Prover::new(&STATEMENT, Pads::new(pads.clone()));
    let mut proving = Proving::new(prover, vec![instance], 1, &silently);
    let mut parts = Parts::default();
    let left = argue(&mut proving, &relations, &mut parts).unwrap();
    share(&mut proving, &mut parts, &SOURCES, &left.secret).unwrap();
    (proving.prover.finish().unwrap(), pads)
}

/// Verifies, with the pads, and with what the sources are at the last points.
fn verify(
    (proof, pads): &(Vec<u64>, Vec<Extension>),
    values: &[Vec<i64>; 2],
) -> Result<(), Refused> {
    let mut verifier = Verifier::new(&STATEMENT, proof);
    let mut verifying = Verifying::new(&mut verifier);
    let mut parts = Parts::default();
    let left = argue(&mut verifying, &relations(), &mut parts)?;
    let (point, shared) = share(&mut verifying, &mut parts, &SOURCES, &left.secret)?;
    let equations = verifying.equations;
    let padded = verifier.padded().iter().zip(pads);
    let secrets: Vec<Extension> = padded.map(|(&said, &pad)| said - pad).collect();
    if let Some(unmet) = equations.unmet(&secrets) {
        return Err(Refused::Equation(unmet));
    }
    for ((values, bits), value) in values.iter().zip(BITS).zip(shared) {
        let elements: Vec<Goldilocks> = values.iter().map(|&v| Goldilocks::from_i64(v)).collect();
        if evaluate(&elements, &point.own[..bits]) != value.value(&secrets, &[]) {
            return Err(Refused::Equation("the value of a source"));
        }
    }
    verifier.finish()
}

#[test]
fn what_holds_is_accepted() {
    for seed in 0..5 {
        let mut values = values(seed);
        fill_counts(&mut values).unwrap();
        assert_eq!(verify(&prove(&values), &values), Ok(()));
    }
}

#[test]
fn a_changed_word_is_refused() {
    let mut values = values(1);
    fill_counts(&mut values).unwrap();
    let (proof, pads) = prove(&values);
    let told = |words: Vec<u64>| verify(&(words, pads.clone()), &values);
    for word in 0..proof.len() {
        let mut changed = proof.clone();
        changed[word] = (changed[word] + 1) % 0xffff_ffff_0000_0001;
        assert!(told(changed).is_err(), "word {word} of {}", proof.len());
    }
    assert!(told(proof[1..].to_vec()).is_err());
    assert!(told(proof[..proof.len() - 1].to_vec()).is_err());
}

/// Each committed value that follows from others is changed. The prover counts again where it can, and argues as if nothing were wrong.
#[test]
fn a_changed_value_is_refused() {
    let used = [
        Y..CHOSEN,
        CHOSEN..LARGEST + 16,
        SHIFTED..SHIFTED + 8,
        COUNTS..COUNTS + 512,
    ];
    for index in used.into_iter().flatten().step_by(3) {
        let mut values = values(2);
        fill_counts(&mut values).unwrap();
        values[0][index] += 1;
        if index < COUNTS {
            let _ = fill_counts(&mut values);
        }
        // Rows beyond the mask are free to have any remainder.
        let free = index < Y + (1 << 7) && index % 4 == 3;
        if !free {
            assert!(verify(&prove(&values), &values).is_err(), "value {index}");
        }
    }
}

#[test]
fn what_is_in_no_table_is_named() {
    let mut values = values(3);
    values[0][Y + 5] += 1;
    let missing = fill_counts(&mut values).unwrap_err();
    assert_eq!((missing.lookup, missing.index), ("the rest of y", 5));
}

/// Public tensors are at a point what their values state.
#[test]
fn publics_are_their_values() {
    let relations = relations();
    let mut prover = Prover::new(&STATEMENT, Pads::new(vec![]));
    for public in &relations.publics {
        let axis = public.axes()[0];
        let bits = relations.bits(axis);
        let values: Vec<Goldilocks> = (0..1 << bits).map(|i| public.value(&[i])).collect();
        let point = prover.challenges(bits);
        let at = public.at(&[&Part::Point(point.clone())]);
        assert_eq!(at, evaluate(&values, &point));
        assert_eq!(at, public.at(&[&Part::Vector(eq_table(&point))]));
        assert_ne!(at, Extension::ZERO);
    }
}
