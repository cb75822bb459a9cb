//! Who knows no sample can make the words of an argument, if the challenges are known before: from the statement and the weights alone. So the words tell
//! nothing else, as long as what is stated is uniform, which the other tests here show.

use super::made::{elements, Made};
use crate::models::Models;
use std::ops::Range;
use zk0_argument::commitment::parameters::{CAP, LAST, SALT};
use zk0_argument::commitment::prove::{open, Encoder, Message};
use zk0_argument::commitment::Segment;
use zk0_argument::expert::argument::{argued, verify_with, Argued};
use zk0_argument::expert::builder::{TABLES, WEIGHTS};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::form::Form;
use zk0_argument::fractions::LeafClaim;
use zk0_argument::hash::{Sponge, SpongeDigest, SpongeDomain};
use zk0_argument::layout::LookupLayout;
use zk0_argument::multilinear::{bind, eq_table, evaluate_extension};
use zk0_argument::opening::{self, RANDOM};
use zk0_argument::party::{Fold, Party, Sources, Sum, ValueClaim, Weighted};
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{value, SourceValues};
use zk0_argument::relation::{Parts, Relations};
use zk0_argument::sumcheck::JoinedPoint;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused, Verifier};
use zk0_argument::tree::prove::Tree;
use zk0_argument::verify::Verifying;
use zk0_circuits::EvalSpec;

/// Reads words that look random, but computes what is published.
struct Computing<'a, 'v> {
    verifying: Verifying<'a, 'v>,
    weights: SourceValues<'a>,
    tables: SourceValues<'a>,
    /// The places of published values, and these.
    published: Vec<(usize, Extension)>,
}

impl Challenges for Computing<'_, '_> {
    fn challenge(&mut self) -> Extension {
        self.verifying.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.verifying.positions(count, bits)
    }
}

impl Party for Computing<'_, '_> {
    type Value = Form;

    fn published(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let place = self.verifying.verifier.place();
        self.verifying.published(parts, about)?;
        let source = match about.source {
            WEIGHTS => self.weights,
            TABLES => self.tables,
            other => panic!("{other:?} is not published"),
        };
        let value = value(source, parts, about);
        self.published.push((place, value));
        Ok(value)
    }

    fn value(&mut self, parts: &Parts, about: &Weighted) -> Result<Form, Refused> {
        Party::value(&mut self.verifying, parts, about)
    }

    fn nothing(&mut self, about: &Weighted) -> Form {
        self.verifying.nothing(about)
    }

    fn product(&mut self, a: &Form, b: &Form) -> Result<Form, Refused> {
        self.verifying.product(a, b)
    }

    fn zero(&mut self, what: &'static str, value: Form) -> Result<(), Refused> {
        self.verifying.zero(what, value)
    }

    fn sum(&mut self, relations: &Relations, parts: &Parts, sum: &Sum) -> Result<Form, Refused> {
        self.verifying.sum(relations, parts, sum)
    }

    fn work(&mut self, bits: u32, what: &'static str) -> Result<(), Refused> {
        self.verifying.work(bits, what)
    }

    fn fractions(
        &mut self,
        instance: usize,
        layout: &LookupLayout,
        fold: &Fold,
    ) -> Result<LeafClaim<Form>, Refused> {
        self.verifying.fractions(instance, layout, fold)
    }

    fn gather(
        &mut self,
        layout: &LookupLayout,
        fold: &Fold,
        claims: &[LeafClaim<Form>],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Form), Refused> {
        self.verifying.gather(layout, fold, claims, gamma)
    }

    fn gathered(&mut self, count: usize) -> Result<Vec<[Form; 2]>, Refused> {
        self.verifying.gathered(count)
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Form)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Form), Refused> {
        self.verifying.reduce(relations, parts, sums, gamma, degree)
    }

    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &Sources<'_>,
        claims: &[ValueClaim<Form>],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Form), Refused> {
        self.verifying.reduce_claims(parts, sources, claims, gamma)
    }
}

fn put(words: &mut [u64], place: usize, values: &[Extension]) {
    let words = words[place..].iter_mut();
    for (word, value) in words.zip(Extension::coefficients(values)) {
        *word = value.value();
    }
}

/// The words of an argument for a statement, of which there are so many.
fn simulate(made: &Made, count: usize) -> Vec<u64> {
    let (statement, shape) = (&made.statement, &made.shape);
    let (digest, expert) = (statement.digest(), Expert::new(statement));
    let parameters = &shape.parameters;
    let segments = shape.segments();
    let caps = (4 * segments.len()) << CAP;
    let mut words = vec![0; caps];
    let random = elements(17, count - caps);
    words.extend(random.iter().map(|element| element.value()));

    // Everything up to the values of columns is random, but for what is published.
    let mut verifier = Verifier::new(&digest, &words).deaf();
    for widths in segments.clone() {
        Segment::receive(&mut verifier, widths).unwrap();
    }
    let [weights, tables] = made.published();
    let mut computing = Computing {
        verifying: Verifying::new(&mut verifier),
        weights,
        tables,
        published: vec![],
    };
    argued(&mut computing, &expert, shape).unwrap();
    let published = computing.published;
    let place = verifier.place();
    for (place, value) in published {
        put(&mut words, place, &[value]);
    }
    let read = |words: &[u64]| {
        let mut verifier = Verifier::new(&digest, words).deaf();
        let argued = Argued::read(&mut verifier, statement, &expert, shape).unwrap();
        let (point, sums) = (argued.point, argued.sums);
        let end = opening::read(argued.verifying, &point, shape.first_random(), &sums).unwrap();
        (point, end, verifier.place())
    };

    // F and the value of U are random, and all else at the end follows from them.
    let height = 1 << parameters.variables();
    let extension = |seed: u64, count: usize| -> Vec<Extension> {
        Extension::of_coefficients(&elements(seed, 2 * count)).to_vec()
    };
    let message = extension(18, height);
    let tail = extension(19, parameters.longest_tail());
    let (point, end, _) = read(&words);
    let of_random = extension(20, 1)[0];
    let there = evaluate_extension(&message, &point) - end.xi * of_random;
    // After two proofs of work and two values
    let place = place + 1 + 4 + 1;
    put(&mut words, place, &[there, of_random]);
    let (_, end, last) = read(&words);
    let entries = message.as_chunks::<2>().0.iter().zip(&end.omega);
    let x = Extension([Goldilocks::ZERO, Goldilocks::ONE]);
    let product = entries.map(|(&[even, odd], &omega)| omega * (even + x * odd));
    let product = product.sum::<Extension>() - end.xi * end.delta;
    let rounds = last - 2 - 4 * parameters.variables();
    put(&mut words, rounds - 1 - 2, &[product]);
    let mut weights = eq_table(&point);
    for (entries, &omega) in weights.as_chunks_mut::<2>().0.iter_mut().zip(&end.omega) {
        entries[0] += end.eta * omega;
        entries[1] += end.eta * omega * x;
    }
    let mut left = message.clone();
    for (round, &challenge) in end.opened.point.iter().enumerate() {
        let pairs = weights
            .as_chunks::<2>()
            .0
            .iter()
            .zip(left.as_chunks::<2>().0);
        let pairs: Vec<_> = pairs.collect();
        let constant = pairs.iter().map(|(a, b)| a[0] * b[0]).sum();
        let square = pairs
            .iter()
            .map(|(a, b)| (a[1] - a[0]) * (b[1] - b[0]))
            .sum();
        put(&mut words, rounds + 4 * round, &[constant, square]);
        bind(&mut weights, challenge);
        bind(&mut left, challenge);
    }
    put(&mut words, last - 2, &left);

    // The folding of F is honest. No rows are opened here.
    let mut prover = Prover::new(&digest, Pads::new(vec![])).deaf();
    let opened = &end.opened.point;
    while Some(&prover.challenge()) != opened.last() {}
    let codeword = [0, 1].map(|part| {
        let of = |values: &[Extension]| values.iter().map(|v| v.0[part]).collect::<Vec<_>>();
        Encoder::new(2).encode(&of(&message), &of(&tail))
    });
    let message = Message {
        values: message,
        tail,
    };
    open(&mut prover, parameters, &[], message, opened, &silently);
    let folded = prover.finish().unwrap();

    // Rows are random, but for those of the random polynomial, which make up for the others.
    let queries = made.queries(count);
    let first = queries[0].segments[0].0.start;
    words.splice(last..first, folded[..first - last].iter().copied());
    // Between the last challenge of the sumcheck and the positions, the folding and a proof of work draw.
    let mut drawing = Prover::new(&digest, Pads::new(vec![])).deaf();
    while Some(&drawing.challenge()) != opened.last() {}
    drawing.challenges(parameters.variables() - LAST as usize + 1);
    let length = codeword[0].len().ilog2();
    let positions = drawing.positions(parameters.positions(), length);
    let leaves = vec![SpongeDigest::default(); 4 * height];
    let mut trees = vec![leaves; segments.len()];
    for (query, &position) in queries.iter().zip(&positions) {
        let row = |segment: usize| query.segments[segment].0.clone();
        let first_random = row(0).start + shape.first_random();
        let mut sum = Extension([0, 1].map(|part| codeword[part][position]));
        let rows = (0..segments.len()).flat_map(row);
        for (place, &weight) in rows.zip(&end.opened.weights) {
            if !(first_random..first_random + RANDOM - 1).contains(&place) {
                sum -= weight.scale(Goldilocks::of_words(&words[place..=place]).unwrap()[0]);
            }
        }
        let of_g = sum * end.opened.weights[shape.first_random()].inverse();
        put(&mut words, first_random, &[of_g]);
        for (number, widths) in segments.iter().enumerate() {
            let values = row(number);
            let own = &words[values.start..values.end + SALT];
            trees[number][parameters.leaf(position)] = leaf(own, widths);
        }
    }
    let own: Range<usize> = first - last..folded.len();
    let each = own.len() / positions.len();
    let trees: Vec<Tree> = trees
        .into_iter()
        .map(|leaves| Tree::of_leaves(leaves, CAP))
        .collect();
    for (number, (query, &position)) in queries.iter().zip(&positions).enumerate() {
        for ((_, path), tree) in query.segments.iter().zip(&trees) {
            let digests = tree
                .path(parameters.leaf(position))
                .into_iter()
                .flat_map(|digest| digest.0);
            words.splice(path.clone(), digests);
        }
        let end = query.segments.last().unwrap().1.end;
        let folded = folded[own.start + number * each..][..each].iter().copied();
        words.splice(end..end + each, folded);
    }
    let digests = trees.iter().flat_map(Tree::cap).flat_map(|digest| digest.0);
    words.splice(..caps, digests);
    words
}

/// The digest of a row with its salt.
fn leaf(row: &[u64], widths: &[usize]) -> SpongeDigest {
    let row = Goldilocks::of_words(row).unwrap();
    let mut sponge = Sponge::new(SpongeDomain::Leaf, row.len());
    let mut rest = row;
    for &width in &widths[..widths.len() - 1] {
        let (now, later) = rest.split_at(width);
        sponge.absorb(now);
        rest = later;
    }
    sponge.absorb(rest);
    sponge.digest()
}

#[test]
fn words_that_are_accepted_can_be_made_without_a_sample() {
    for samples in [1, 2] {
        let made = Made::new(&Models::new(&EvalSpec::micro(), samples, 95));
        let honest = made.argue(&super::made::Blinding::of(95, samples as u64), true);
        let words = simulate(&made, honest.words().len());
        let verifier = Verifier::new(&made.statement.digest(), &words).deaf();
        verify_with(&made.statement, verifier).unwrap();
    }
}
