//! Measures the prover: `speed commit 24`, `speed fractions 24`, `speed computed 24` (the same fractions, computed whenever they are read) or
//! `speed shared 20`, where the number is the binary logarithm of the size.
//! It prints the seconds of each step and those of all cores together, the most memory that was used up to then, and the digest of the proof.

use std::error::Error;
use std::time::Instant;
use std::{env, fs};
use zk0_argument::claim::Blind;
use zk0_argument::commitment::prove::columns::Column;
use zk0_argument::commitment::prove::{open, CodeMatrix, Committing, Hiding, Message};
use zk0_argument::commitment::{Parameters, Rate};
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::fractions::{self, prove::Leaves};
use zk0_argument::hash::{leaf, SpongeDigest};
use zk0_argument::party::{Sources, ValueClaim, Weighted};
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{Instance, Proving, SourceValues};
use zk0_argument::relation::{ColumnSource, Part, Parts, Relations};
use zk0_argument::share::share;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused};

/// Columns of the committed matrix.
const WIDTH: usize = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let what = arguments
        .next()
        .ok_or("commit, fractions, computed or shared")?;
    let size: u32 = arguments
        .next()
        .ok_or("binary logarithm of the size")?
        .parse()?;
    let pads =
        (1..1 << 12).map(|seed| Extension([small(seed), small(!seed)].map(Goldilocks::from_i64)));
    let prover = Prover::new(&SpongeDigest([1, 2, 3, 4]), Pads::new(pads.collect()));
    let proof = match what.as_str() {
        "commit" => commit(prover, size)?,
        "fractions" => sum(prover, size)?,
        "computed" => computed(prover, size)?,
        "shared" => shared(prover, size)?,
        _ => return Err("commit, fractions, computed or shared".into()),
    };
    let words = Goldilocks::of_words(&proof).map_err(|place| format!("word {place}"))?;
    println!("{} words, {:?}", proof.len(), leaf(words));
    Ok(())
}

/// Prints how long a step took, and the most memory up to now.
fn measured<T>(what: &str, step: impl FnOnce() -> T) -> T {
    let (begin, used) = (Instant::now(), processor());
    let result = step();
    let (seconds, used) = (begin.elapsed().as_secs_f64(), processor() - used);
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = peak.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    let gibibytes = kilobytes.unwrap_or_default() / f64::from(1 << 20);
    println!("{what}: {seconds:.2} s, {used:.2} s of processors, peak {gibibytes:.2} GiB");
    result
}

/// Seconds that all threads have computed.
fn processor() -> f64 {
    let status = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields 14 and 15, in hundredths; field 2 may hold spaces and ends in a parenthesis.
    let fields = status.rsplit(") ").next().unwrap_or_default();
    let ticks = fields.split(' ').skip(11).take(2);
    ticks
        .filter_map(|field| field.parse::<f64>().ok())
        .sum::<f64>()
        / 100.
}

fn small(index: usize) -> i64 {
    (index as i64).wrapping_mul(0x9E37_79B9_7F4A_7C15_u64 as i64) >> 48
}

fn commit(mut prover: Prover, size: u32) -> Result<Vec<u64>, Box<dyn Error>> {
    let parameters = Parameters::new(size - WIDTH.ilog2(), Rate::Quarter).ok_or("size")?;
    let values: Vec<i64> = measured("values", || (0..1 << size).map(small).collect());
    let hiding = Blind::new([5; 32]).of_argument(&SpongeDigest([1, 2, 3, 4]))?;
    let committed = measured("commit", || {
        let columns = Column::cut(&values, 1 << parameters.variables(), WIDTH);
        let tails = (0..WIDTH).map(|column| hiding.elements(column, parameters.positions()));
        let matrix = CodeMatrix::new(columns, tails.collect());
        Committing::new(&parameters, WIDTH).finish(matrix, Box::new(hiding))
    });
    committed.say(&mut prover);
    let weights = prover.challenges(WIDTH);
    let point = prover.challenges(parameters.variables());
    measured("open", || {
        let segments = [&committed];
        let message = Message::of_columns(&parameters, &segments, &weights);
        open(
            &mut prover,
            &parameters,
            &segments,
            message,
            &point,
            &silently,
        );
    });
    Ok(prover.finish()?)
}

/// Fractions as look-ups have them: most numerators are 1, some are counts, and the last eighth is 0/1.
struct Fractions {
    shift: Extension,
    used: usize,
}

impl Fractions {
    fn new(prover: &mut Prover, size: u32) -> Self {
        Self {
            shift: prover.challenge(),
            used: (1usize << size) / 8 * 7,
        }
    }

    fn numerator(&self, index: usize) -> Goldilocks {
        Goldilocks::from_i64(match index % 4 {
            3 => -small(index),
            _ => 1,
        })
    }

    fn denominator(&self, index: usize) -> Extension {
        self.shift - Goldilocks::from_i64(small(index)).into()
    }
}

impl Leaves for Fractions {
    type Numerator = Goldilocks;

    fn len(&self) -> usize {
        self.used
    }

    fn read(&self, first: usize, numerators: &mut [Goldilocks], denominators: &mut [Extension]) {
        let fractions = numerators.iter_mut().zip(denominators).enumerate();
        for (index, (numerator, denominator)) in fractions {
            *numerator = self.numerator(first + index);
            *denominator = self.denominator(first + index);
        }
    }
}

fn sum(mut prover: Prover, size: u32) -> Result<Vec<u64>, Refused> {
    let fractions = Fractions::new(&mut prover, size);
    let (numerators, denominators) = measured("values", || {
        let used = 0..fractions.used;
        let numerators = used.clone().map(|i| fractions.numerator(i).into());
        let mut numerators: Vec<Extension> = numerators.collect();
        let mut denominators: Vec<Extension> = used.map(|i| fractions.denominator(i)).collect();
        numerators.resize(1 << size, Extension::ZERO);
        denominators.resize(1 << size, Extension::ONE);
        (numerators, denominators)
    });
    measured("fractions", || {
        fractions::prove::sum(&mut prover, numerators, denominators)
    });
    prover.finish()
}

fn computed(mut prover: Prover, size: u32) -> Result<Vec<u64>, Refused> {
    let fractions = Fractions::new(&mut prover, size);
    measured("fractions", || {
        fractions::prove::sum_of(&mut prover, size as usize, fractions)
    });
    prover.finish()
}

/// A sumcheck of weights times values, which three claims about one source become.
fn shared(prover: Prover, size: u32) -> Result<Vec<u64>, Box<dyn Error>> {
    let values: Vec<i64> = (0..1 << size).map(small).collect();
    let instance = Instance {
        relations: &Relations::default(),
        sources: vec![SourceValues::Wide(&values)],
    };
    let mut proving = Proving::new(prover, vec![instance], 1, &silently);
    let mut parts = Parts::default();
    let claims = [0, 1, 3].map(|quarter| {
        let bits = size as usize - 2;
        let point = Part::Point(proving.challenges(bits));
        ValueClaim {
            about: Weighted {
                source: ColumnSource(0),
                offset: quarter << bits,
                parts: vec![(0, parts.add(point))],
                instances: None,
            },
            value: Extension::ZERO,
        }
    });
    measured("shared", || {
        // The claims are wrong, so that the proof is too: it takes as long as a right one.
        let _ = share(
            &mut proving,
            &mut parts,
            &Sources {
                all: &[(ColumnSource(0), size as usize)],
                instances: 0,
            },
            &claims,
        );
    });
    Ok(proving.prover.finish()?)
}
