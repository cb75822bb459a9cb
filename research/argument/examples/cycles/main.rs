//! Counts the cycles of a guest program, by operation and by function.
//!
//! `cargo run --release --example cycles -- PROGRAM.elf FOLDER…`
//!
//! The program is what `build-guest.sh --budget` or `--unsound` builds. A folder holds its inputs, 0.bin and 1.bin.

mod machine;

use machine::Machine;
use std::error::Error;
use std::{env, fs};

/// Functions that are listed.
const LISTED: usize = 25;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let elf = fs::read(arguments.next().ok_or("usage: cycles PROGRAM.elf FOLDER…")?)?;
    for folder in arguments {
        let inputs = ["0.bin", "1.bin"].map(|name| fs::read(format!("{folder}/{name}")));
        let inputs = inputs.into_iter().collect::<Result<_, _>>()?;
        let mut machine = Machine::load(&elf, inputs).ok_or("this file is not an ELF of a guest")?;
        machine.run()?;
        println!("{folder}: {} cycles", machine.cycles);
        let named: u64 = machine.operations.values().map(|(cycles, _)| cycles).sum();
        let rest = ("all else".to_string(), (machine.cycles - named, 1));
        for (name, (cycles, times)) in machine.operations.iter().map(|(n, c)| (n.clone(), *c)).chain([rest]) {
            println!("{cycles:>12}  {name} ({times})");
        }
        for (name, cycles) in functions(&elf, &machine).into_iter().take(LISTED) {
            println!("{cycles:>12}  {name}");
        }
    }
    Ok(())
}

/// The cycles of each function whose name the program has.
fn functions(elf: &[u8], machine: &Machine) -> Vec<(String, u64)> {
    let number = |at: usize, bytes: usize| -> usize {
        let field = elf.get(at..at + bytes).unwrap_or_default();
        field.iter().rev().fold(0, |all, &byte| all << 8 | byte as usize)
    };
    let (headers, size, count) = (number(40, 8), number(58, 2), number(60, 2));
    let mut all = vec![];
    for section in 0..count {
        let header = headers + section * size;
        if number(header + 4, 4) != 2 {
            continue;
        }
        // A section of symbols names the section of their names.
        let names = number(headers + number(header + 40, 4) * size + 24, 8);
        let symbols = number(header + 24, 8);
        for symbol in (symbols..symbols + number(header + 32, 8)).step_by(24) {
            let (start, length) = (number(symbol + 8, 8), number(symbol + 16, 8));
            let first = start.wrapping_sub(machine.code_start as usize) / 4;
            let Some(counts) = machine.counts.get(first..first + length / 4) else {
                continue;
            };
            let name = elf[names + number(symbol, 4)..].iter().take_while(|byte| **byte != 0);
            let name: Vec<u8> = name.copied().collect();
            let cycles = counts.iter().sum();
            all.push((String::from_utf8_lossy(&name).into_owned(), cycles));
        }
    }
    all.sort_by_key(|(_, cycles)| std::cmp::Reverse(*cycles));
    all
}
