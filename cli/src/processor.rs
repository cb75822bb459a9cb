//! Says that the processor is too old for this program, which the system would end with "Illegal instruction" otherwise.
//!
//! The check runs before anything else of the program, because all of it may use AVX2: also what runs before `main`, such as the constructors of
//! RocksDB's C++. The linker puts the functions of `.preinit_array` first.

use std::arch::x86_64::{__cpuid, __cpuid_count};

const TOO_OLD: &str = "error: this processor has no AVX2, for which this program was built: \
    build zk0 with RUSTFLAGS=\"-C target-cpu=x86-64\" (see .cargo/config.toml)\n";

/// An audit that ends so has no verdict.
const EXIT_CODE: i32 = 4;

#[used]
#[link_section = ".preinit_array"]
static FIRST: extern "C" fn() = check;

extern "C" {
    fn write(file: i32, bytes: *const u8, count: usize) -> isize;
    fn _exit(code: i32) -> !;
}

/// Nothing here is worth a vector instruction to the compiler. A test runs it on a processor that has none of AVX.
extern "C" fn check() {
    let has_avx2 = __cpuid(0).eax >= 7 && __cpuid_count(7, 0).ebx & 1 << 5 != 0;
    if !has_avx2 {
        // Rust's own standard library is not ready yet.
        unsafe {
            write(2, TOO_OLD.as_ptr(), TOO_OLD.len());
            _exit(EXIT_CODE);
        }
    }
}
