//! Refuses a processor that is too old, for which the system would only print "Illegal instruction".
//!
//! The check runs first, because other code may use AVX2 even before `main`, as RocksDB's constructors do. The linker puts `.preinit_array`
//! first.

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

/// Needs no vector instruction. A test runs this without AVX.
extern "C" fn check() {
    let has_avx2 = __cpuid(0).eax >= 7 && __cpuid_count(7, 0).ebx & 1 << 5 != 0;
    if !has_avx2 {
        // Rust's standard library is not ready yet.
        unsafe {
            write(2, TOO_OLD.as_ptr(), TOO_OLD.len());
            _exit(EXIT_CODE);
        }
    }
}
