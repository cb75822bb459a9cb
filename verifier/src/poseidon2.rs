//! SP1's Poseidon2 permutation ([paper](https://eprint.iacr.org/2023/323)), in AVX2 where the processor has it.
//!
//! Verifying a compressed proof is 34,000 permutations, one after the other, and nine tenths of the time. `p3`, which SP1 is
//! built on, permutes several states at once in AVX2, but one state in scalar code. Here one state fills four registers.
//! Elsewhere, and in the tests, the permutation is `p3`'s.

use serde::{Deserialize, Serialize};
use slop_koala_bear::{my_kb_16_perm, KoalaPerm};
use slop_symmetric::{CryptographicPermutation, Permutation};
use sp1_primitives::SP1Field;
use std::sync::LazyLock;

/// Elements of a state.
const WIDTH: usize = 16;

/// The permutation, of 16 KoalaBear elements: 4 external rounds, 20 internal, 4 external, S-box x³.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Poseidon2;

impl Permutation<[SP1Field; WIDTH]> for Poseidon2 {
    fn permute_mut(&self, state: &mut [SP1Field; WIDTH]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            unsafe { avx2::permute(state) };
            return;
        }
        static PORTABLE: LazyLock<KoalaPerm> = LazyLock::new(my_kb_16_perm);
        PORTABLE.permute_mut(state);
    }
}

impl CryptographicPermutation<[SP1Field; WIDTH]> for Poseidon2 {}

/// A register has four elements, each in 64 bits: register `k` holds the elements `k`, `4 + k`, `8 + k` and `12 + k`. So the
/// external layer's 4×4 matrix works across registers, and its sums over groups within one.
///
/// Elements are in Montgomery form, x·2³² mod P, as `p3` has them. Bounds are given as multiples of 2³¹, which is a little
/// more than P.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{SP1Field, WIDTH};
    use slop_koala_bear::{
        KoalaBear_BEGIN_EXT_CONSTS, KoalaBear_END_EXT_CONSTS, KoalaBear_PARTIAL_CONSTS,
    };
    use std::{arch::x86_64::*, array, sync::LazyLock};

    /// The KoalaBear prime, 2³¹ − 2²⁴ + 1.
    const P: u32 = 0x7f00_0001;
    /// 1/P mod 2³².
    const P_INVERSE: u32 = 0x8100_0001;

    /// The internal layer's matrix is 1 + diag(−2, 2⁰, 2¹, …), over 2³²: the exponents, without the first element's.
    const SHIFTS: [u64; WIDTH] = [0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 15];

    type State = [__m256i; 4];

    struct Constants {
        begin: [State; 4],
        internal: [u32; 20],
        end: [State; 4],
        shifts: State,
    }

    static CONSTANTS: LazyLock<Constants> = LazyLock::new(|| {
        let round =
            |constants: &[SP1Field; WIDTH]| registers(constants.map(|c| montgomery(c).into()));
        Constants {
            begin: KoalaBear_BEGIN_EXT_CONSTS.each_ref().map(round),
            internal: KoalaBear_PARTIAL_CONSTS.map(montgomery),
            end: KoalaBear_END_EXT_CONSTS.each_ref().map(round),
            shifts: registers(SHIFTS),
        }
    });

    fn registers(elements: [u64; WIDTH]) -> State {
        array::from_fn(|k| {
            bytemuck::cast::<[u64; 4], __m256i>(array::from_fn(|g| elements[4 * g + k]))
        })
    }

    const _: () = assert!(size_of::<SP1Field>() == 4 && align_of::<SP1Field>() == 4);

    fn montgomery(element: SP1Field) -> u32 {
        // SAFETY: an element is `repr(transparent)` over a u32.
        unsafe { std::mem::transmute(element) }
    }

    /// x/2³² mod P, canonical, of x < P·2³².
    #[inline(always)]
    fn reduce(x: u64) -> u32 {
        let multiple = (u64::from((x as u32).wrapping_mul(P_INVERSE)) * u64::from(P)) >> 32;
        let difference = ((x >> 32) as u32).wrapping_sub(multiple as u32);
        difference.min(difference.wrapping_add(P))
    }

    #[inline(always)]
    fn multiply(a: u32, b: u32) -> u32 {
        reduce(u64::from(a) * u64::from(b))
    }

    /// [`reduce`] of four.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn reduce4(x: __m256i) -> __m256i {
        let p = _mm256_set1_epi64x(P.into());
        let multiple =
            _mm256_mul_epu32(_mm256_mul_epu32(x, _mm256_set1_epi64x(P_INVERSE.into())), p);
        let difference = _mm256_srli_epi64(_mm256_sub_epi64(x, multiple), 32);
        _mm256_min_epu32(difference, _mm256_add_epi32(difference, p))
    }

    /// The same elements below 1.29 × 2³¹, of those below 37 × 2³¹: 2³¹ is 2²⁴ − 1 mod P.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn fold(x: __m256i) -> __m256i {
        let high = _mm256_srli_epi64(x, 31);
        let low = _mm256_and_si256(x, _mm256_set1_epi64x(0x7fff_ffff));
        _mm256_add_epi64(low, _mm256_sub_epi64(_mm256_slli_epi64(high, 24), high))
    }

    /// The same elements, canonical, of those that [`fold`] takes.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn canonical(x: __m256i) -> __m256i {
        let x = fold(x);
        _mm256_min_epu32(x, _mm256_sub_epi32(x, _mm256_set1_epi64x(P.into())))
    }

    /// The external layer. Of elements below 1 it makes some below 35.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn external_layer(v: State) -> State {
        let total = _mm256_add_epi64(_mm256_add_epi64(v[0], v[1]), _mm256_add_epi64(v[2], v[3]));
        array::from_fn(|k| {
            let next = v[(k + 1) % 4];
            let own = _mm256_add_epi64(_mm256_add_epi64(total, v[k]), _mm256_add_epi64(next, next));
            let halves = _mm256_add_epi64(own, _mm256_permute2x128_si256(own, own, 1));
            let groups = _mm256_add_epi64(halves, _mm256_shuffle_epi32(halves, 0x4e));
            _mm256_add_epi64(own, groups)
        })
    }

    /// Adds the round's constants, cubes, and applies the external layer.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn external_round(v: State, constants: &State) -> State {
        let cubed = array::from_fn(|k| {
            // Below 1.29: both products are below P·2³², which is 1.98 × 2⁶².
            let x = fold(_mm256_add_epi64(v[k], constants[k]));
            let square = reduce4(_mm256_mul_epu32(x, x));
            reduce4(_mm256_mul_epu32(square, x))
        });
        external_layer(cubed)
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn sum(v: &State) -> u64 {
        let v = _mm256_add_epi64(_mm256_add_epi64(v[0], v[1]), _mm256_add_epi64(v[2], v[3]));
        let v = _mm_add_epi64(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
        _mm_cvtsi128_si64(_mm_add_epi64(v, _mm_unpackhi_epi64(v, v))) as u64
    }

    #[target_feature(enable = "avx2")]
    pub fn permute(state: &mut [SP1Field; WIDTH]) {
        let constants = &*CONSTANTS;
        let mut v = registers(state.map(|element| montgomery(element).into()));
        v = external_layer(v);
        for round in &constants.begin {
            v = external_round(v, round);
        }

        // The first element is kept apart, its place in the registers 0. What the next round needs of the sum of the others
        // is computed from this round's, so that one round waits for another by the first element alone.
        let others = _mm256_set_epi64x(-1, -1, -1, 0);
        v = array::from_fn(|k| canonical(v[k]));
        let mut first = _mm256_extract_epi64(v[0], 0) as u32;
        v[0] = _mm256_and_si256(v[0], others);
        let mut rest = sum(&v);
        for constant in &constants.internal {
            let scaled: State = array::from_fn(|k| _mm256_sllv_epi64(v[k], constants.shifts[k]));
            let scaled_sum = sum(&scaled);
            let x = first + constant;
            let x = x.min(x.wrapping_sub(P));
            let cube = u64::from(multiply(multiply(x, x), x));
            let full = rest + cube;
            first = reduce(rest + (u64::from(P) - cube));
            rest = reduce(15 * full + scaled_sum).into();
            let full = _mm256_set1_epi64x(full as i64);
            v = array::from_fn(|k| reduce4(_mm256_add_epi64(scaled[k], full)));
            v[0] = _mm256_and_si256(v[0], others);
        }
        v[0] = _mm256_or_si256(v[0], _mm256_set_epi64x(0, 0, 0, first.into()));

        for round in &constants.end {
            v = external_round(v, round);
        }
        for (k, register) in v.into_iter().enumerate() {
            let elements: [u64; 4] = bytemuck::cast(canonical(register));
            for (g, element) in elements.into_iter().enumerate() {
                // SAFETY: an element is `repr(transparent)` over a u32, which is canonical here.
                state[4 * g + k] = unsafe { std::mem::transmute::<u32, SP1Field>(element as u32) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use slop_algebra::{AbstractField, Field, PrimeField32};

    fn same(state: [SP1Field; WIDTH]) {
        static P3: LazyLock<KoalaPerm> = LazyLock::new(my_kb_16_perm);
        assert_eq!(Poseidon2.permute(state), P3.permute(state), "{state:?}");
    }

    #[test]
    fn states_of_extremes_are_permuted_as_p3_does() {
        // The element that is P − 1 in Montgomery form.
        let largest = -SP1Field::from_wrapped_u64(1 << 32).inverse();
        for places in 0..1u32 << WIDTH {
            same(std::array::from_fn(|i| match places >> i & 1 {
                1 => largest,
                _ => SP1Field::zero(),
            }));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn states_are_permuted_as_p3_does(state in prop::array::uniform16(0..SP1Field::ORDER_U32)) {
            same(state.map(SP1Field::from_canonical_u32));
        }
    }
}
