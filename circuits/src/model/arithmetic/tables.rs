//! The nonlinear functions as tables of little-endian u16 under `circuits/tables/`. A test compares the tables with the formulas
//! given here. They are data because `libm` differs between machines, and the evaluation must not.

/// Reads a table file at compile time.
const fn table<const N: usize>(bytes: &[u8]) -> [u16; N] {
    assert!(bytes.len() == 2 * N);
    let mut entries = [0; N];
    let mut index = 0;
    while index < N {
        entries[index] = u16::from_le_bytes([bytes[2 * index], bytes[2 * index + 1]]);
        index += 1;
    }
    entries
}

/// `round(2^15 · sin(π/2 · i/1024))`, i = 0..=1024: a quarter wave.
static SINE: [u16; 1025] = table(include_bytes!("../../../tables/sine.bin"));
/// `round(2^15 · 2^(−i/1024))`, i = 0..2^14: sixteen halvings.
static EXP2: [u16; 1 << 14] = table(include_bytes!("../../../tables/exp2.bin"));
/// `round(2^15 / (1 + e^(−(i − 2^14)/1024)))`, i = 0..2^15: the logistic function from −16 to 16.
static SIGMOID: [u16; 1 << 15] = table(include_bytes!("../../../tables/sigmoid.bin"));
/// `round(2^12 · Φ⁻¹(1/2 + (i + 1/2)/4096))`, i = 0..2048: the upper half of the normal distribution's quantiles.
static GAUSS: [u16; 2048] = table(include_bytes!("../../../tables/gauss.bin"));
/// `round(2^16 · (0.999 · ((i + 1/2)/4096)^(2/3) + 0.001))`, i = 0..4096: quantiles of LeRobot's flow time, 0.999 times
/// a Beta(1.5, 1) variable plus 0.001.
static FLOW_TIME: [u16; 4096] = table(include_bytes!("../../../tables/beta.bin"));

/// Fraction bits of [`sine`] and [`cosine`].
pub const TRIG_BITS: u32 = 14;
/// Fraction bits of [`exp2_negative`]'s argument.
pub const EXPONENT_BITS: u32 = 10;
/// Fraction bits of [`exp2_negative`].
pub const EXP_BITS: u32 = 15;
/// Fraction bits of [`sigmoid`]'s argument.
pub const LOGIT_BITS: u32 = 10;
/// Fraction bits of [`sigmoid`].
pub const SIGMOID_BITS: u32 = 15;
/// Fraction bits of [`gaussian`].
pub const GAUSS_BITS: u32 = 12;
/// Bits of the share of the distribution that [`flow_time`] takes.
pub const FLOW_TIME_BITS: u32 = 12;

/// Cosine and sine of an angle in units of 2^-32 turns; in [−2^14, 2^14]. They are linear between table entries, with an error of at most
/// 2^-14.
#[inline(always)]
pub fn turn(phase: u32) -> (i16, i16) {
    let (quadrant, within) = (phase >> 30, phase & 0x3fff_ffff);
    let position = match quadrant & 1 {
        0 => within,
        _ => (1 << 30) - within,
    };
    let (index, fraction) = ((position >> 20) as usize, (position & 0xf_ffff) as i64);
    // The table from its end on has the cosines.
    let entry = |index: usize| SINE[index] as i64;
    let (sine, cosine) = if index < 1024 {
        let (low, high) = (entry(index), entry(1024 - index));
        (
            (low << 20) + (entry(index + 1) - low) * fraction,
            (high << 20) - (high - entry(1023 - index)) * fraction,
        )
    } else {
        (entry(1024) << 20, entry(0) << 20)
    };
    let rounded = |value: i64, negative: bool| {
        let value = (value + (1 << 20)) >> 21;
        (if negative { -value } else { value }) as i16
    };
    (
        rounded(cosine, quadrant == 1 || quadrant == 2),
        rounded(sine, quadrant >= 2),
    )
}

/// Sine, like [`turn`].
pub fn sine(phase: u32) -> i16 {
    turn(phase).1
}

/// Cosine, like [`turn`].
pub fn cosine(phase: u32) -> i16 {
    turn(phase).0
}

/// 2^(−x) for `x` ≥ 0 with [`EXPONENT_BITS`] fraction bits; in [0, 2^15], and 0 from 16 on.
#[inline(always)]
pub fn exp2_negative(x: u64) -> u16 {
    match EXP2.get(x as usize) {
        Some(&value) => value,
        None => 0,
    }
}

/// Logistic function of `x` with [`LOGIT_BITS`] fraction bits; in [0, 2^15], constant beyond ±16.
#[inline(always)]
pub fn sigmoid(x: i64) -> i64 {
    match SIGMOID.get((x + (1 << 14)) as usize) {
        Some(&value) => value as i64,
        None if x < 0 => 0,
        None => 1 << SIGMOID_BITS,
    }
}

/// A standard normal value with 12 fraction bits from 12 uniform bits: bit 11 is the sign, the lower ones are the quantile.
#[inline(always)]
pub fn gaussian(uniform: u16) -> i16 {
    let magnitude = GAUSS[(uniform & 0x7ff) as usize] as i16;
    if uniform >> 11 & 1 == 0 {
        magnitude
    } else {
        -magnitude
    }
}

/// The flow time, in units of 2^-16, of a share of the distribution in units of 2^-[`FLOW_TIME_BITS`] (the low bits).
pub fn flow_time(share: u16) -> u16 {
    FLOW_TIME[(share & 0xfff) as usize]
}
