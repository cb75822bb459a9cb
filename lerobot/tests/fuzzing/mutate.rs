//! Changes to an input.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Numbers that lengths and counts go wrong at.
const NUMBERS: [u32; 10] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0xffff,
    0x00ff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
];

/// What numbers in JSON go wrong at.
const WORDS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "2",
    "4096",
    "2147483648",
    "18446744073709551616",
    "1e308",
    "-1e400",
    "0.5",
    "null",
    "[]",
    "\"\"",
    "{}",
];

const MAX_LEN: usize = 1 << 20;

/// One to four changes; `other` is an input to borrow from.
pub fn mutate(input: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..rng.random_range(1..5) {
        change(&mut bytes, other, rng);
    }
    bytes.truncate(MAX_LEN);
    bytes
}

fn change(bytes: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
    if bytes.is_empty() {
        bytes.extend(other);
        return;
    }
    let at = place(bytes.len(), rng);
    let end = (at + rng.random_range(1..64usize)).min(bytes.len());
    match rng.random_range(0..12) {
        0 => bytes[at] ^= 1 << rng.random_range(0..8),
        1 => bytes[at] = rng.random(),
        2 => bytes[at] = bytes[at].wrapping_add(rng.random_range(0..5u8).wrapping_sub(2)),
        3 | 4 => {
            let number = NUMBERS[rng.random_range(0..NUMBERS.len())];
            let word = match rng.random() {
                true => number.to_be_bytes(),
                false => number.to_le_bytes(),
            };
            let end = (at + 4).min(bytes.len());
            bytes[at..end].copy_from_slice(&word[..end - at]);
        }
        5 => rng.fill(&mut bytes[at..end]),
        6 => drop(bytes.drain(at..end)),
        7 => {
            let again = bytes[at..end].to_vec();
            let to = place(bytes.len(), rng);
            bytes.splice(to..to, again);
        }
        8 => bytes.truncate(at),
        9 if !other.is_empty() => {
            let from = place(other.len(), rng);
            let upto = (from + rng.random_range(1..256usize)).min(other.len());
            bytes.splice(at..end, other[from..upto].iter().copied());
        }
        _ => number(bytes, at, rng),
    }
}

/// Replaces the next decimal number after `at`, as JSON has them.
fn number(bytes: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    let Some(from) = bytes[at..].iter().position(u8::is_ascii_digit) else {
        return;
    };
    let from = at + from;
    let len = bytes[from..]
        .iter()
        .take_while(|b| b.is_ascii_digit())
        .count();
    let word = WORDS[rng.random_range(0..WORDS.len())];
    bytes.splice(from..from + len, word.bytes());
}

/// A place, half the time in the first or last 2 KiB, where indices are.
fn place(len: usize, rng: &mut ChaCha8Rng) -> usize {
    match rng.random_range(0..4) {
        0 => rng.random_range(0..len.min(2048)),
        1 => len - 1 - rng.random_range(0..len.min(2048)),
        _ => rng.random_range(0..len),
    }
}
