//! Our side of `scripts/bench-simulate`: small federations that are all overhead.
//!
//!     bench_simulate data FOLDER NODES            writes the data of softmax regressions
//!     bench_simulate softmax FOLDER NODES ROUNDS  trains them, and writes the weights to FOLDER/ours.f64
//!     bench_simulate noop BYTES NODES ROUNDS      sends updates of so many bytes that are what the nodes got
//!
//! All numbers are float64, so that both sides can be compared closely.

mod noop;
mod softmax;

use std::env;
use std::process::ExitCode;
use std::thread;

const USAGE: &str = "usage: bench_simulate data FOLDER NODES | softmax FOLDER NODES ROUNDS | noop BYTES NODES ROUNDS";

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments: Vec<_> = env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench_simulate: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<(), Failure> {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["data", folder, nodes] => softmax::make(folder.as_ref(), nodes.parse()?),
        ["softmax", folder, nodes, rounds] => {
            softmax::train(folder.as_ref(), nodes.parse()?, rounds.parse()?, threads)
        }
        ["noop", bytes, nodes, rounds] => {
            noop::run(bytes.parse()?, nodes.parse()?, rounds.parse()?, threads)
        }
        _ => Err(USAGE.into()),
    }
}
