//! Poseidon2 in vectors of 512 bits, which a program chooses when it starts: what `p3-koala-bear` computes with is chosen when it is compiled.
//!
//! Values are in Montgomery's form: x stands for x/2^32 modulo P.

use super::vectors::{inner_layer, PoseidonConstants, Vectors, INNER_ROUNDS, LANES, WIDTH};
use core::arch::x86_64::*;
use std::sync::LazyLock;

/// The modulus, 2^31 − 2^24 + 1.
const P: u32 = 0x7f00_0001;
/// Its inverse modulo 2^32.
const INVERSE: u32 = 0x8100_0001;
/// 2^64 modulo P.
const SQUARE: u32 = ((1u128 << 64) % P as u128) as u32;

/// Vectors of 512 bits.
#[derive(Clone, Copy)]
pub struct Avx512;

/// The constants in Montgomery's form, or as they are where a product with them is to be divided by 2^32.
struct Montgomery {
    outer: [[[u32; WIDTH]; 4]; 2],
    inner: [(u32, u32); INNER_ROUNDS],
    last: u32,
}

static CONSTANTS: LazyLock<Montgomery> = LazyLock::new(|| {
    let form = |value: u32| ((u64::from(value) << 32) % u64::from(P)) as u32;
    let constants = PoseidonConstants::new();
    Montgomery {
        outer: constants
            .outer
            .map(|rounds| rounds.map(|round| round.map(form))),
        inner: constants
            .inner
            .map(|(added, factor)| (form(added), form(factor))),
        last: form(constants.last),
    }
});

/// Whether this processor has them.
pub fn are_there() -> bool {
    std::arch::is_x86_feature_detected!("avx512f")
}

impl Vectors for Avx512 {
    type State = [__m512i; WIDTH];

    fn zero() -> Self::State {
        // SAFETY: any bits are integers.
        unsafe { core::mem::zeroed() }
    }

    #[inline(always)]
    fn load(state: &mut Self::State, word: usize, words: &[u64; LANES]) {
        // SAFETY: whoever has this type has seen that the processor can do this.
        unsafe { load(state, word, words) }
    }

    #[inline(always)]
    fn permute(state: &mut Self::State) {
        // SAFETY: likewise.
        unsafe { permute(state, &CONSTANTS) }
    }

    #[inline(always)]
    fn store(state: &Self::State, word: usize) -> [u64; LANES] {
        // SAFETY: likewise.
        unsafe { store(state, word) }
    }
}

#[target_feature(enable = "avx512f")]
fn broadcast(value: u32) -> __m512i {
    _mm512_set1_epi32(value as i32)
}

#[target_feature(enable = "avx512f")]
fn add(a: __m512i, b: __m512i) -> __m512i {
    let sum = _mm512_add_epi32(a, b);
    _mm512_min_epu32(sum, _mm512_sub_epi32(sum, broadcast(P)))
}

#[target_feature(enable = "avx512f")]
fn sub(a: __m512i, b: __m512i) -> __m512i {
    let difference = _mm512_sub_epi32(a, b);
    _mm512_min_epu32(difference, _mm512_add_epi32(difference, broadcast(P)))
}

/// The products divided by 2^32, given the odd lanes of `b` in even ones. One factor is below P.
#[target_feature(enable = "avx512f")]
fn mul_halves(a: __m512i, b: __m512i, b_odd: __m512i) -> __m512i {
    let (p, inverse) = (broadcast(P), broadcast(INVERSE));
    let even = _mm512_mul_epu32(a, b);
    let odd = _mm512_mul_epu32(_mm512_srli_epi64::<32>(a), b_odd);
    // What has the same lower half, and is a multiple of P
    let same_even = _mm512_mul_epu32(_mm512_mul_epu32(even, inverse), p);
    let same_odd = _mm512_mul_epu32(_mm512_mul_epu32(odd, inverse), p);
    sub(upper(even, odd), upper(same_even, same_odd))
}

/// The upper halves of what was computed of even and of odd lanes.
#[target_feature(enable = "avx512f")]
fn upper(even: __m512i, odd: __m512i) -> __m512i {
    _mm512_mask_blend_epi32(0xaaaa, _mm512_srli_epi64::<32>(even), odd)
}

#[target_feature(enable = "avx512f")]
fn mul(a: __m512i, b: __m512i) -> __m512i {
    mul_halves(a, b, _mm512_srli_epi64::<32>(b))
}

#[target_feature(enable = "avx512f")]
fn times(a: __m512i, factor: u32) -> __m512i {
    let factor = broadcast(factor);
    mul_halves(a, factor, factor)
}

/// x/2^J, where UP is 24 − J.
#[target_feature(enable = "avx512f")]
fn divided<const J: u32, const UP: u32>(a: __m512i) -> __m512i {
    let low = _mm512_and_si512(a, broadcast((1 << J) - 1));
    let low = _mm512_sub_epi32(_mm512_slli_epi32::<7>(low), low);
    sub(_mm512_srli_epi32::<J>(a), _mm512_slli_epi32::<UP>(low))
}

#[target_feature(enable = "avx512f")]
fn cube(a: __m512i) -> __m512i {
    mul(mul(a, a), a)
}

/// Multiplies by the circulant matrix of (2·M, M, M, M), where M is that of (2, 3, 1, 1).
#[target_feature(enable = "avx512f")]
fn outer_layer(state: &mut [__m512i; WIDTH]) {
    for four in state.as_chunks_mut::<4>().0 {
        let [a, b, c, d] = *four;
        let (ab, cd) = (add(a, b), add(c, d));
        let all = add(ab, cd);
        let (with_b, with_d) = (add(all, b), add(all, d));
        *four = [
            add(with_b, ab),
            add(with_b, add(c, c)),
            add(with_d, cd),
            add(with_d, add(a, a)),
        ];
    }
    let [a, b, c, d] = state.as_chunks::<4>().0 else {
        return;
    };
    let mut sums = *a;
    for (place, sum) in sums.iter_mut().enumerate() {
        *sum = add(add(*sum, b[place]), add(c[place], d[place]));
    }
    for (place, value) in state.iter_mut().enumerate() {
        *value = add(*value, sums[place % 4]);
    }
}

#[target_feature(enable = "avx512f")]
fn outer_rounds(state: &mut [__m512i; WIDTH], rounds: &[[u32; WIDTH]; 4]) {
    for round in rounds {
        for (value, &constant) in state.iter_mut().zip(round) {
            *value = cube(add(*value, broadcast(constant)));
        }
        outer_layer(state);
    }
}

#[target_feature(enable = "avx512f")]
fn permute(state: &mut [__m512i; WIDTH], constants: &Montgomery) {
    outer_layer(state);
    outer_rounds(state, &constants.outer[0]);
    for &(constant, factor) in &constants.inner {
        let first = times(cube(add(state[0], broadcast(constant))), factor);
        state[0] = first;
        inner_layer!(state, add, sub, divided);
    }
    for value in state.iter_mut() {
        *value = times(*value, constants.last);
    }
    outer_rounds(state, &constants.outer[1]);
}

/// Words with these halves.
#[target_feature(enable = "avx512f")]
fn join(lower: __m256i, upper: __m256i) -> __m512i {
    let upper = _mm512_slli_epi64::<32>(_mm512_cvtepu32_epi64(upper));
    _mm512_or_si512(_mm512_cvtepu32_epi64(lower), upper)
}

/// The lower or upper halves of words of all lanes.
#[target_feature(enable = "avx512f")]
fn halves(low: __m512i, high: __m512i) -> __m512i {
    let low = _mm512_castsi256_si512(_mm512_cvtepi64_epi32(low));
    _mm512_inserti64x4::<1>(low, _mm512_cvtepi64_epi32(high))
}

#[target_feature(enable = "avx512f")]
fn load(state: &mut [__m512i; WIDTH], word: usize, words: &[u64; LANES]) {
    let [low, high]: [__m512i; 2] = bytes(words);
    let lower = halves(low, high);
    let upper = halves(_mm512_srli_epi64::<32>(low), _mm512_srli_epi64::<32>(high));
    state[2 * word] = times(lower, SQUARE);
    state[2 * word + 1] = times(upper, SQUARE);
}

#[target_feature(enable = "avx512f")]
fn store(state: &[__m512i; WIDTH], word: usize) -> [u64; LANES] {
    let (lower, upper) = (times(state[2 * word], 1), times(state[2 * word + 1], 1));
    let low = join(_mm512_castsi512_si256(lower), _mm512_castsi512_si256(upper));
    let high = join(
        _mm512_extracti64x4_epi64::<1>(lower),
        _mm512_extracti64x4_epi64::<1>(upper),
    );
    // SAFETY: both have as many bits, and any bits are integers.
    unsafe { core::mem::transmute([low, high]) }
}

fn bytes(words: &[u64; LANES]) -> [__m512i; 2] {
    // SAFETY: both have as many bits, and any bits are integers.
    unsafe { core::mem::transmute(*words) }
}
