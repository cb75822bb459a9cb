//! KoalaBear (p = 2^31 − 2^24 + 1) and its extension of degree 4, x^4 = 3: SP1's own two fields.
//!
//! Values are canonical in memory, as the Poseidon2 precompile wants them: nothing is converted before hashing.

use core::ops::{Add, AddAssign, Mul, Neg, Sub};

/// The modulus.
pub const P: u32 = 0x7f00_0001;

/// An element of KoalaBear, canonical when made by this module; [`F::all_canonical`] checks those that were read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct F(pub u32);

/// `value` mod p.
#[inline(always)]
fn reduce(value: u64) -> u32 {
    #[cfg(not(target_os = "zkvm"))]
    return (value % P as u64) as u32;
    // One instruction; the multiplication by an inverse that compilers make of `%` takes four, and no fewer trace cells.
    #[cfg(target_os = "zkvm")]
    {
        let rest: u64;
        // SAFETY: an arithmetic instruction without side effects.
        unsafe {
            core::arch::asm!("remu {0}, {1}, {2}", out(reg) rest, in(reg) value, in(reg) P as u64,
                options(pure, nomem, nostack))
        };
        rest as u32
    }
}

impl F {
    /// Zero.
    pub const ZERO: F = F(0);
    /// One.
    pub const ONE: F = F(1);

    /// The field element that `value` stands for.
    pub fn from_i64(value: i64) -> F {
        F(value.rem_euclid(P as i64) as u32)
    }

    /// Whether all of `values` are below the modulus.
    pub fn all_canonical(values: &[F]) -> bool {
        values.iter().all(|value| value.0 < P)
    }

    /// `self^exponent`.
    pub fn pow(self, mut exponent: u64) -> F {
        let (mut power, mut base) = (F::ONE, self);
        while exponent > 0 {
            if exponent & 1 == 1 {
                power = power * base;
            }
            base = base * base;
            exponent >>= 1;
        }
        power
    }

    /// 1/self; 0 for 0.
    pub fn inverse(self) -> F {
        self.pow(P as u64 - 2)
    }

    /// A generator of the subgroup of order 2^`bits`, `bits` ≤ 24.
    pub fn root_of_unity(bits: usize) -> F {
        // 3 generates the multiplicative group, of order 2^24 · 127.
        F(3).pow((P as u64 - 1) >> bits)
    }
}

impl Add for F {
    type Output = F;
    #[inline(always)]
    fn add(self, other: F) -> F {
        let sum = self.0 + other.0;
        F(sum.min(sum.wrapping_sub(P)))
    }
}

impl Sub for F {
    type Output = F;
    #[inline(always)]
    fn sub(self, other: F) -> F {
        let difference = self.0.wrapping_sub(other.0);
        F(difference.min(difference.wrapping_add(P)))
    }
}

impl Neg for F {
    type Output = F;
    #[inline(always)]
    fn neg(self) -> F {
        F::ZERO - self
    }
}

impl Mul for F {
    type Output = F;
    #[inline(always)]
    fn mul(self, other: F) -> F {
        F(reduce(self.0 as u64 * other.0 as u64))
    }
}

/// An element of the extension, coefficients of 1, x, x², x³.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct E(pub [F; 4]);

impl E {
    /// Zero.
    pub const ZERO: E = E([F::ZERO; 4]);
    /// One.
    pub const ONE: E = E([F::ONE, F::ZERO, F::ZERO, F::ZERO]);

    /// `self · scalar`.
    #[inline(always)]
    pub fn scale(self, scalar: F) -> E {
        E(self.0.map(|value| value * scalar))
    }

    /// The elements whose coefficients lie one after the other in `values`.
    pub fn from_slice(values: &[F]) -> &[E] {
        // SAFETY: E is four F and nothing else.
        unsafe { core::slice::from_raw_parts(values.as_ptr().cast(), values.len() / 4) }
    }

    /// The coefficients of `values`, one after the other.
    pub fn as_coefficients(values: &[E]) -> &[F] {
        // SAFETY: E is four F and nothing else.
        unsafe { core::slice::from_raw_parts(values.as_ptr().cast(), values.len() * 4) }
    }

    /// `Σ weights · values`.
    #[inline(always)]
    pub fn dot_base(weights: &[E], values: &[F]) -> E {
        // Four products of values below p stay below 2^64.
        let mut sums = [0u64; 4];
        let (weights, values) = (weights.chunks(3), values.chunks(3));
        for (weights, values) in weights.zip(values) {
            sums = sums.map(|sum| reduce(sum) as u64);
            for (weight, value) in weights.iter().zip(values) {
                for (sum, coefficient) in sums.iter_mut().zip(weight.0) {
                    *sum += coefficient.0 as u64 * value.0 as u64;
                }
            }
        }
        E(sums.map(|sum| F(reduce(sum))))
    }
}

impl From<F> for E {
    #[inline(always)]
    fn from(value: F) -> E {
        E([value, F::ZERO, F::ZERO, F::ZERO])
    }
}

impl Add for E {
    type Output = E;
    #[inline(always)]
    fn add(self, other: E) -> E {
        E(core::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl AddAssign for E {
    #[inline(always)]
    fn add_assign(&mut self, other: E) {
        *self = *self + other;
    }
}

impl Sub for E {
    type Output = E;
    #[inline(always)]
    fn sub(self, other: E) -> E {
        E(core::array::from_fn(|i| self.0[i] - other.0[i]))
    }
}

impl Mul for E {
    type Output = E;
    #[inline(always)]
    fn mul(self, other: E) -> E {
        let [a0, a1, a2, a3] = self.0.map(|value| value.0 as u64);
        let [b0, b1, b2, b3] = other.0.map(|value| value.0 as u64);
        // Each sum has at most four products of values below p, which stays below 2^64 (p² < 0.985 · 2^62).
        let high = |value: u64| {
            let rest = reduce(value) as u64;
            rest + rest + rest
        };
        E([
            F(reduce(a0 * b0 + high(a1 * b3 + a2 * b2 + a3 * b1))),
            F(reduce(a0 * b1 + a1 * b0 + high(a2 * b3 + a3 * b2))),
            F(reduce(a0 * b2 + a1 * b1 + a2 * b0 + high(a3 * b3))),
            F(reduce(a0 * b3 + a1 * b2 + a2 * b1 + a3 * b0)),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slop_algebra::{extension::BinomialExtensionField, AbstractExtensionField, AbstractField, PrimeField32};
    use slop_koala_bear::KoalaBear;

    #[test]
    fn products_are_those_of_sp1s_field() {
        type Theirs = BinomialExtensionField<KoalaBear, 4>;
        let mut seed = 1u64;
        let mut next = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            F(((seed >> 33) % P as u64) as u32)
        };
        for round in 0..1000 {
            let mut random = || E([next(), next(), next(), next()]);
            let (mut a, b) = (random(), random());
            if round == 0 {
                a = E([F(P - 1); 4]);
            }
            let theirs = |e: E| Theirs::from_base_slice(&e.0.map(|v| KoalaBear::from_canonical_u32(v.0)));
            let product: Theirs = theirs(a) * theirs(b);
            let product: Vec<u32> = AbstractExtensionField::<KoalaBear>::as_base_slice(&product).iter().map(|v| v.as_canonical_u32()).collect();
            assert_eq!((a * b).0.map(|v| v.0).to_vec(), product);
        }
        assert_eq!(F::root_of_unity(24).pow(1 << 23), F(P - 1));
        assert_eq!(F(5) * F(5).inverse(), F::ONE);
    }
}
