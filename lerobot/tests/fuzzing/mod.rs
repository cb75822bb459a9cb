//! Random inputs for everything that reads files, kept as far as they lead to something new.
//!
//! Without coverage of the code: what tells inputs apart is what the reader says of them. An input whose outcome was not seen
//! before joins those that are mutated, so that errors behind other errors are reached.

mod corpus;
mod mutate;

use std::collections::btree_map::Entry;
use std::collections::BTreeMap;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::allocations::peak;

// Of the test that this is part of.
use crate::targets::{Target, SLACK};

pub use corpus::{fuzz, read_again};

/// How long outcomes found are minimised, all together.
const MINIMISING: Duration = Duration::from_secs(20);

/// What an input may make the reader allocate at once.
pub fn allowed(input: &[u8]) -> usize {
    SLACK + 64 * input.len()
}

/// What came of an input: the error without numbers and paths, or `read`. `Err` is a finding: a panic, or too large an allocation.
pub fn run(target: &mut Target, input: &[u8]) -> Result<String, String> {
    let (outcome, bytes) = peak(|| catch_unwind(AssertUnwindSafe(|| (target.run)(input))));
    let outcome = outcome.map_err(|_| "a panic".to_owned())?;
    if bytes > allowed(input) {
        return Err(format!(
            "{bytes} bytes allocated for {} of input",
            input.len()
        ));
    }
    Ok(match outcome {
        Ok(()) => "read".into(),
        Err(message) => class(&message),
    })
}

/// What libraries quote as it is, quotation marks and all.
const QUOTED: [&str; 3] = [
    "unknown field",
    "unknown variant",
    "invalid offset for tensor",
];

/// The message without numbers, digests and what it quotes, so that one fault is one outcome.
fn class(message: &str) -> String {
    let ends = QUOTED
        .iter()
        .filter_map(|q| Some(message.find(q)? + q.len()));
    let message = unquoted(&message[..ends.min().unwrap_or(message.len())]);
    let message = match message.strip_prefix('\'') {
        // What is quoted may hold quotation marks itself.
        Some(quoted) => quoted.rsplit_once("' ").map_or("", |(_, rest)| rest),
        None => &message,
    };
    let (message, _) = message.split_once(" '").unwrap_or((message, ""));
    let words = message.split(|c: char| !c.is_ascii_alphanumeric() && c != ' ');
    let words = words.flat_map(|words| words.split_inclusive(' '));
    let is_digest = |word: &str| word.len() >= 32 && word.bytes().all(|b| b.is_ascii_hexdigit());
    let letters = words
        .filter(|word| !is_digest(word.trim_end()))
        .flat_map(str::chars)
        .filter(|c| c.is_ascii_alphabetic() || *c == ' ');
    letters.take(60).collect()
}

/// The message without what is between `"` and `"`, as Rust escapes it, or between two backticks.
fn unquoted(message: &str) -> String {
    let (mut left, mut open, mut escaped) = (String::new(), None, false);
    for c in message.chars() {
        match open {
            None if c == '"' || c == '`' => open = Some(c),
            None => left.push(c),
            Some(_) if escaped => escaped = false,
            Some('"') if c == '\\' => escaped = true,
            Some(mark) if c == mark => open = None,
            Some(_) => {}
        }
    }
    left
}

/// What was found in some time.
pub struct Found {
    pub runs: u64,
    /// By outcome, the smallest input that leads to it.
    pub outcomes: BTreeMap<String, Vec<u8>>,
    /// What is wrong, and the input.
    pub findings: Vec<(String, Vec<u8>)>,
}

/// Mutates the target's seeds and `corpus` for `time`; the seed decides everything but how far it gets.
pub fn explore(target: &mut Target, corpus: Vec<Vec<u8>>, time: Duration, seed: u64) -> Found {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut pool = target.seeds.clone();
    pool.extend(corpus);
    let mut found = Found {
        runs: 0,
        outcomes: BTreeMap::new(),
        findings: Vec::new(),
    };
    let start = Instant::now();
    let mut next = 0;
    while start.elapsed() < time && found.findings.len() < 20 {
        // First the inputs as they are.
        let input = match pool.get(next) {
            Some(input) => input.clone(),
            None => {
                let picked = rng.random_range(0..pool.len());
                let other = rng.random_range(0..pool.len());
                mutate::mutate(&pool[picked], &pool[other], &mut rng)
            }
        };
        let is_new_to_pool = next >= pool.len();
        next += 1;
        found.runs += 1;
        match run(target, &input) {
            Ok(outcome) => {
                if let Entry::Vacant(place) = found.outcomes.entry(outcome) {
                    if is_new_to_pool {
                        pool.push(input.clone());
                        next = pool.len();
                    }
                    place.insert(input);
                }
            }
            Err(finding) => found.findings.push((finding, input)),
        }
    }
    let deadline = Instant::now() + MINIMISING;
    for (outcome, input) in &mut found.outcomes {
        *input = minimised(target, input.clone(), outcome, deadline);
    }
    found
}

/// A smaller input of the same outcome, by leaving out stretches; at most 400 attempts.
fn minimised(target: &mut Target, mut input: Vec<u8>, outcome: &str, deadline: Instant) -> Vec<u8> {
    let mut stretch = input.len() / 2;
    let mut left = 400;
    while stretch > 0 && left > 0 && Instant::now() < deadline {
        let mut at = 0;
        while at < input.len() && left > 0 && Instant::now() < deadline {
            left -= 1;
            let end = (at + stretch).min(input.len());
            let shorter = [&input[..at], &input[end..]].concat();
            if run(target, &shorter).as_deref() == Ok(outcome) {
                input = shorter;
            } else {
                at += stretch;
            }
        }
        stretch /= 2;
    }
    input
}
