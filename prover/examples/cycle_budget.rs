//! How many of a claim's guest cycles each operation takes. `make cycles` runs this.
//!
//! `cargo run --release --workspace --example cycle_budget FOLDER MODE SAMPLES PROFILE…`
//!
//! The folder holds the ELFs that `circuits/build-guest.sh --budget` writes. A program states when an operation starts and ends
//! (`zk0_circuits::vm::budget`), in lines on its standard output. SP1's own executor counts these only in a build for profiling, so this
//! example is a plain RV64IM interpreter with the system calls that the program makes. It counts one cycle for each instruction, as SP1
//! does, and makes no proof.

use serde_json::json;
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::{env, fs};
use zk0_circuits::vm::poseidon2::{permute, State};
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::program::{synthetic, PreparedClaim};

fn main() -> Result<(), Box<dyn Error>> {
    const USAGE: &str = "usage: cycle_budget FOLDER MODE SAMPLES PROFILE…";
    let mut arguments = env::args().skip(1);
    let folder = arguments.next().ok_or(USAGE)?;
    let mode: Mode = arguments.next().ok_or(USAGE)?.parse()?;
    let elf = fs::read(Path::new(&folder).join(format!("{mode}.elf")))?;
    let samples = arguments.next().ok_or(USAGE)?.parse()?;
    for profile in arguments {
        let spec = EvalSpec::new(synthetic::dims(&profile)?);
        let private = synthetic::private_input(&spec, mode, samples, 1)?;
        let (blind, folder) = (synthetic::blind(1), env::temp_dir());
        let input = PreparedClaim::of(mode, &private, &blind, Some(&folder), &mut |_| {})?.input;
        let mut machine = Machine::load(&elf, input.buffers).ok_or("not an ELF of the guest")?;
        machine.run()?;
        let named = machine.operations.values().sum::<u64>();
        machine
            .operations
            .insert("all else".into(), machine.cycles - named);
        let line = json!({
            "profile": profile, "mode": mode.to_string(), "samples": samples,
            "cycles": machine.cycles, "operations": machine.operations,
        });
        println!("{line}");
    }
    Ok(())
}

const PAGE_BITS: u32 = 16;
/// How many bits the addresses that SP1 gives a program have.
const MEMORY_BITS: u32 = 38;
type Page = [u8; 1 << PAGE_BITS];

struct Machine {
    pages: Vec<Option<Box<Page>>>,
    code: Vec<u32>,
    code_start: u64,
    pc: u64,
    registers: [u64; 32],
    input: std::vec::IntoIter<Vec<u8>>,
    /// How many instructions have run so far.
    cycles: u64,
    operations: BTreeMap<String, u64>,
    /// The operations that have started and not ended.
    running: Vec<String>,
    /// Up to where cycles are charged.
    charged: u64,
}

impl Machine {
    /// Loads an ELF's segments.
    fn load(elf: &[u8], input: Vec<Vec<u8>>) -> Option<Self> {
        let number = |at: usize, bytes: usize| -> Option<u64> {
            let field = elf.get(at..at + bytes)?;
            Some(
                field
                    .iter()
                    .rev()
                    .fold(0, |all, &byte| all << 8 | byte as u64),
            )
        };
        let mut machine = Self {
            pages: vec![None; 1 << (MEMORY_BITS - PAGE_BITS)],
            code: vec![],
            code_start: 0,
            pc: number(24, 8)?,
            registers: [0; 32],
            input: input.into_iter(),
            cycles: 0,
            operations: BTreeMap::new(),
            running: vec![],
            charged: 0,
        };
        let (headers, size, count) = (number(32, 8)?, number(54, 2)?, number(56, 2)?);
        for index in 0..count {
            let header = (headers + index * size) as usize;
            let (loaded, executable) = (number(header, 4)? == 1, number(header + 4, 4)? & 1 == 1);
            if !loaded {
                continue;
            }
            let (offset, address) = (number(header + 8, 8)? as usize, number(header + 16, 8)?);
            let segment = elf.get(offset..offset + number(header + 32, 8)? as usize)?;
            for (at, &byte) in segment.iter().enumerate() {
                machine.store(address + at as u64, 1, byte as u64).ok()?;
            }
            if executable {
                let words = segment.as_chunks::<4>().0.iter();
                machine.code = words.map(|word| u32::from_le_bytes(*word)).collect();
                machine.code_start = address;
            }
        }
        Some(machine)
    }

    fn page(&mut self, address: u64) -> Result<&mut Page, String> {
        match self.pages.get_mut((address >> PAGE_BITS) as usize) {
            Some(page) => Ok(page.get_or_insert_with(|| Box::new([0; 1 << PAGE_BITS]))),
            None => Err(format!("address {address:#x} at {:#x}", self.pc)),
        }
    }

    /// Loads `bytes` bytes from an address that is a multiple of `bytes`.
    fn load_bytes(&mut self, address: u64, bytes: usize) -> Result<u64, String> {
        let at = address as usize & ((1 << PAGE_BITS) - 1);
        let mut word = [0; 8];
        word[..bytes].copy_from_slice(&self.page(address)?[at..at + bytes]);
        Ok(u64::from_le_bytes(word))
    }

    fn store(&mut self, address: u64, bytes: usize, value: u64) -> Result<(), String> {
        let at = address as usize & ((1 << PAGE_BITS) - 1);
        self.page(address)?[at..at + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
        Ok(())
    }

    /// Runs the program to its end.
    fn run(&mut self) -> Result<(), String> {
        loop {
            let at = (self.pc - self.code_start) as usize / 4;
            let word = *self.code.get(at).ok_or("the program left its code")?;
            self.cycles += 1;
            if word == 0x73 {
                if !self.system_call()? {
                    return Ok(());
                }
                self.pc += 4;
            } else {
                self.step(word)?;
            }
        }
    }

    /// Executes one instruction of RV64IM (The RISC-V Instruction Set Manual, volume I).
    fn step(&mut self, word: u32) -> Result<(), String> {
        let (rd, funct3, funct7) = (word >> 7 & 31, word >> 12 & 7, word >> 25);
        let a = self.registers[(word >> 15 & 31) as usize];
        let b = self.registers[(word >> 20 & 31) as usize];
        let immediate = (word as i32 >> 20) as u64;
        let upper = (word & 0xffff_f000) as i32 as u64;
        let mut next = self.pc + 4;
        let word32 = |value: u64| value as i32 as u64;
        let result = match word & 0x7f {
            0x37 => upper,
            0x17 => self.pc.wrapping_add(upper),
            0x6f => {
                let low = (word >> 21 & 0x3ff) << 1 | (word >> 20 & 1) << 11 | word & 0xff000;
                let offset = ((word as i32 >> 31) << 20) as u64 | low as u64;
                let link = next;
                next = self.pc.wrapping_add(offset);
                link
            }
            0x67 => {
                let link = next;
                next = a.wrapping_add(immediate) & !1;
                link
            }
            0x63 => {
                let low = (word >> 8 & 15) << 1 | (word >> 25 & 63) << 5 | (word >> 7 & 1) << 11;
                let offset = ((word as i32 >> 31) << 12) as u64 | low as u64;
                let taken = match funct3 {
                    0 => a == b,
                    1 => a != b,
                    4 => (a as i64) < b as i64,
                    5 => a as i64 >= b as i64,
                    6 => a < b,
                    _ => a >= b,
                };
                if taken {
                    next = self.pc.wrapping_add(offset);
                }
                self.pc = next;
                return Ok(());
            }
            0x03 => {
                let bytes = 1 << (funct3 & 3);
                let value = self.load_bytes(a.wrapping_add(immediate), bytes)?;
                let unused = 64 - 8 * bytes as u32;
                match funct3 & 4 {
                    0 => ((value << unused) as i64 >> unused) as u64,
                    _ => value,
                }
            }
            0x23 => {
                let offset = ((word as i32 >> 25 << 5) | rd as i32) as u64;
                self.store(a.wrapping_add(offset), 1 << funct3, b)?;
                self.pc = next;
                return Ok(());
            }
            0x13 => arithmetic(funct3, word >> 30 == 1 && funct3 == 5, a, immediate),
            0x33 if funct7 == 1 => multiply(funct3, a, b),
            0x33 => arithmetic(funct3, funct7 == 32, a, b),
            // These instructions work on the low halves of the registers, and shift by five bits of the operand.
            0x1b | 0x3b => {
                let b = if word & 0x20 == 0 { immediate } else { b };
                match (word & 0x20 != 0 && funct7 == 1, funct3) {
                    (true, 5) => word32(multiply(5, a as u32 as u64, b as u32 as u64)),
                    (true, 7) => word32(multiply(7, a as u32 as u64, b as u32 as u64)),
                    (true, _) => word32(multiply(funct3, word32(a), word32(b))),
                    (_, 0) if word & 0x20 != 0 && funct7 == 32 => word32(a.wrapping_sub(b)),
                    (_, 0) => word32(a.wrapping_add(b)),
                    (_, 1) => word32(a << (b & 31)),
                    _ if word >> 30 & 1 == 1 => (a as i32 >> (b & 31)) as u64,
                    _ => word32((a as u32 >> (b & 31)) as u64),
                }
            }
            0x0f => 0, // This is a fence
            opcode => return Err(format!("opcode {opcode:#x} at {:#x}", self.pc)),
        };
        if rd != 0 && word & 0x7f != 0x0f {
            self.registers[rd as usize] = result;
        }
        self.pc = next;
        Ok(())
    }

    /// Executes a system call of SP1 (`sp1-zkvm`, `syscalls`). Returns whether the program goes on.
    fn system_call(&mut self) -> Result<bool, String> {
        let [code, a, b, c] = [5, 10, 11, 12].map(|register| self.registers[register]);
        match code & 0xff {
            0x00 if a == 0 => return Ok(false),
            0x00 => return Err(format!("the program ended with {a}")),
            0x02 => self.write(a, b, c)?,
            0x05 => {
                for at in 16..64 {
                    let mut word = |before| {
                        let value = self.load_bytes(a + 8 * (at - before), 8);
                        value.map(|value| value as u32)
                    };
                    let (x, y) = (word(15)?, word(2)?);
                    let x = x.rotate_right(7) ^ x.rotate_right(18) ^ x >> 3;
                    let y = y.rotate_right(17) ^ y.rotate_right(19) ^ y >> 10;
                    let sum = word(16)?
                        .wrapping_add(x)
                        .wrapping_add(word(7)?)
                        .wrapping_add(y);
                    self.store(a + 8 * at, 8, sum as u64)?;
                }
            }
            0x06 => self.sha256_compress(a, b)?,
            0x10 | 0x1a => {} // The committed values do not matter here
            0x33 => {
                let mut state = State::default();
                for (at, pair) in state.0.iter_mut().enumerate() {
                    *pair = self.load_bytes(a + 8 * at as u64, 8)?;
                }
                permute(&mut state);
                for (at, pair) in state.0.into_iter().enumerate() {
                    self.store(a + 8 * at as u64, 8, pair)?;
                }
            }
            0xf0 => {
                let next = self.input.as_slice().first();
                self.registers[5] = next.map_or(u64::MAX, |buffer| buffer.len() as u64);
            }
            0xf1 => {
                let buffer = self.input.next().ok_or("the program reads too much")?;
                for (at, byte) in buffer.into_iter().take(b as usize).enumerate() {
                    self.store(a + at as u64, 1, byte as u64)?;
                }
            }
            _ => return Err(format!("system call {code:#x} at {:#x}", self.pc)),
        }
        Ok(true)
    }

    /// Compresses a block as in FIPS 180-4, 6.2.2. The words lie in 64 bits each.
    fn sha256_compress(&mut self, words: u64, state: u64) -> Result<(), String> {
        let mut hash = [0u32; 8];
        for (at, value) in hash.iter_mut().enumerate() {
            *value = self.load_bytes(state + 8 * at as u64, 8)? as u32;
        }
        let [mut a, mut b, mut c, mut d, mut e, mut f, mut g, mut h] = hash;
        let primes = (2u32..).filter(|n| (2..*n).take_while(|d| d * d <= *n).all(|d| n % d != 0));
        for (round, prime) in primes.take(64).enumerate() {
            // The constant is the first 32 bits of the fractional part of the prime's cube root.
            let constant = ((prime as f64).cbrt().fract() * 4_294_967_296.0) as u32;
            let word = self.load_bytes(words + 8 * round as u64, 8)? as u32;
            let s1 = e.rotate_right(6) ^ e.rotate_right(11) ^ e.rotate_right(25);
            let choice = e & f ^ !e & g;
            let one = [s1, choice, constant, word]
                .iter()
                .fold(h, |sum, x| sum.wrapping_add(*x));
            let s0 = a.rotate_right(2) ^ a.rotate_right(13) ^ a.rotate_right(22);
            let two = s0.wrapping_add(a & b ^ a & c ^ b & c);
            (h, g, f, e) = (g, f, e, d.wrapping_add(one));
            (d, c, b, a) = (c, b, a, one.wrapping_add(two));
        }
        for (at, (old, new)) in hash.into_iter().zip([a, b, c, d, e, f, g, h]).enumerate() {
            self.store(state + 8 * at as u64, 8, old.wrapping_add(new) as u64)?;
        }
        Ok(())
    }

    /// Charges the cycles since the last report to the operation that runs. One that runs within another is not counted for that one.
    fn charge(&mut self) {
        if let Some(name) = self.running.last() {
            *self.operations.entry(name.clone()).or_default() += self.cycles - self.charged;
        }
        self.charged = self.cycles;
    }

    /// Handles the output of the program. A report of an operation starts or stops the clock of that operation.
    fn write(&mut self, file: u64, start: u64, count: u64) -> Result<(), String> {
        let bytes = (start..start + count).map(|at| self.load_bytes(at, 1).map(|byte| byte as u8));
        let text = String::from_utf8_lossy(&bytes.collect::<Result<Vec<_>, _>>()?).into_owned();
        if let Some(name) = text.strip_prefix("cycle-tracker-report-start: ") {
            self.charge();
            self.running.push(name.trim().into());
        } else if text.starts_with("cycle-tracker-report-end: ") {
            self.charge();
            self.running.pop();
        } else if file == 2 {
            eprint!("{text}");
        }
        Ok(())
    }
}

fn arithmetic(funct3: u32, other: bool, a: u64, b: u64) -> u64 {
    match (funct3, other) {
        (0, false) => a.wrapping_add(b),
        (0, true) => a.wrapping_sub(b),
        (1, _) => a << (b & 63),
        (2, _) => ((a as i64) < b as i64) as u64,
        (3, _) => (a < b) as u64,
        (4, _) => a ^ b,
        (5, false) => a >> (b & 63),
        (5, true) => (a as i64 >> (b & 63)) as u64,
        (6, _) => a | b,
        _ => a & b,
    }
}

fn multiply(funct3: u32, a: u64, b: u64) -> u64 {
    let (signed_a, signed_b) = (a as i64, b as i64);
    match funct3 {
        0 => a.wrapping_mul(b),
        1 => ((signed_a as i128 * signed_b as i128) >> 64) as u64,
        2 => ((signed_a as i128).wrapping_mul(b as i128) >> 64) as u64,
        3 => ((a as u128 * b as u128) >> 64) as u64,
        4 if b == 0 => u64::MAX,
        4 => signed_a.wrapping_div(signed_b) as u64,
        5 => a.checked_div(b).unwrap_or(u64::MAX),
        6 if b == 0 => a,
        6 => signed_a.wrapping_rem(signed_b) as u64,
        _ => a.checked_rem(b).unwrap_or(a),
    }
}
