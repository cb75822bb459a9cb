//! Two arguments of one statement have no word in common that depends on a sample.

use super::made::{alike, Blinding, Made};
use zk0_argument::expert::argument::verify;

/// Proofs of work: of look-ups, of the combination, of the sums, of the pads, and of positions.
const WORKS: usize = 5;

/// With equal challenges, all words differ but those that everybody can compute: both coefficients of each element.
#[test]
fn what_is_said_twice_differs_where_it_depends_on_a_sample() {
    for samples in [1, 2] {
        let [models, _] = alike(samples, 71);
        let made = Made::new(&models);
        let argue = |seed| {
            let words = made.argue(&Blinding::of(seed, samples as u64), true);
            words.finish().unwrap()
        };
        let [first, second] = [1 << 8, 2 << 8].map(argue);
        let equal = first.iter().zip(&second).filter(|(a, b)| a == b).count();
        let heard = made.argue(&Blinding::of(3 << 8, samples as u64), false);
        let verified = verify(&made.statement, &heard.finish().unwrap()).unwrap();
        let published = 2 * verified.published.claims.len();
        assert_eq!(equal, published + WORKS, "of {} words", first.len());
    }
}

/// The challenges are others, so that nothing is equal that depends on a sample, but for digests of its own tree: it is committed to once.
#[test]
fn what_is_argued_twice_has_the_trees_of_samples_in_common() {
    let [models, _] = alike(2, 72);
    let made = Made::new(&models);
    let blinding = |seed| Blinding {
        argument: Blinding::of(seed, 0).argument,
        ..Blinding::of(9 << 8, 2)
    };
    let [first, second] =
        [1 << 8, 2 << 8].map(|seed| made.argue(&blinding(seed), false).finish().unwrap());
    let queries = made.queries(first.len());
    let paths = queries.iter().flat_map(|query| &query.segments[1..]);
    let mut digests: Vec<_> = paths.map(|(_, path)| path.clone()).collect();
    digests.push(4 * 64..4 * 64 * 3);
    // A claim about weights may be zero whatever is drawn.
    let equal = (0..first.len()).filter(|&place| first[place] == second[place] && first[place] > 0);
    let equal = equal.filter(|place| !digests.iter().any(|range| range.contains(place)));
    assert_eq!(
        equal.collect::<Vec<_>>(),
        [0; 0],
        "of {} words",
        first.len()
    );
}
