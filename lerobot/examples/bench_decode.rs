//! How fast a recording is opened, read and validated: `bench_decode RECORDINGS NAME:WHAT`. Prints one JSON line; `scripts/bench-decode`
//! makes the recordings and puts LeRobot's line beside it.
//!
//! The seconds are those of the processor, with those of child processes, so that other programs on the machine do not count.

use std::error::Error;
use std::fs::read_to_string;
use std::path::Path;

use zk0_lerobot::dataset::Dataset;

/// How often a recording is opened.
const OPENINGS: usize = 20;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recordings, case] = &arguments[..] else {
        return Err("usage: bench_decode RECORDINGS NAME:WHAT".into());
    };
    let (name, what) = case.split_once(':').ok_or("the case has no colon")?;
    let (recordings, folder) = (Path::new(recordings), Path::new(recordings).join(name));
    let dataset = Dataset::open(&folder)?;
    let all: Vec<usize> = (0..dataset.len()).collect();
    let began = processor_seconds()?;
    let count = match what {
        "open" => {
            for _ in 0..OPENINGS {
                std::hint::black_box(Dataset::open(&folder)?);
            }
            OPENINGS
        }
        "validate" => match dataset.picture_faults(|_, _| ()).first() {
            Some(fault) => return Err(fault.error.to_string().into()),
            None => all.len(),
        },
        "in-order" => read(&dataset, &all)?,
        "shuffled" => {
            let order = read_to_string(recordings.join("shuffled"))?;
            let order: Vec<usize> = order.lines().map(str::parse).collect::<Result<_, _>>()?;
            read(&dataset, &order)?
        }
        _ => return Err("this is open, validate, in-order or shuffled".into()),
    };
    let seconds = processor_seconds()? - began;
    let line = serde_json::json!({"side": "zk0", "case": case, "each": seconds / count as f64});
    println!("{line}");
    Ok(())
}

/// Reads these frames, and ends what FFmpeg was started for them; gives their number.
fn read(dataset: &Dataset, order: &[usize]) -> Result<usize, Box<dyn Error>> {
    let mut loader = dataset.loader(1)?;
    for &frame in order {
        std::hint::black_box(loader.frame(frame)?);
    }
    Ok(order.len())
}

/// What this process and its ended children have taken, of the processor and of the kernel for them.
fn processor_seconds() -> Result<f64, Box<dyn Error>> {
    /// Linux counts in hundredths of a second there, on every processor.
    const TICKS: f64 = 100.0;
    let stat = read_to_string("/proc/self/stat")?;
    let (_, fields) = stat.rsplit_once(')').ok_or("/proc/self/stat has no name")?;
    let times = fields.split_whitespace().skip(11).take(4);
    let ticks = times.map(str::parse::<u64>).sum::<Result<u64, _>>()?;
    Ok(ticks as f64 / TICKS)
}
