#!/usr/bin/env bash
# Checks that the pure crates compile where they have to: zk0-protocol and zk0-verifier for browsers (wasm32-unknown-unknown), and
# zk0-protocol for SP1's guest. It type-checks them and links nothing.
#
# It uses the toolchain that circuits/build-guest.sh would use, because both targets need a standard library that an ordinary
# toolchain does not bring along.
#
# Environment: ZK0_CHECK_TARGET_DIR, where to build (default: target/check-targets).
#
# Exit code: 0 everything compiles, 1 something does not, 2 the toolchain needed is not installed.
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd -P)
target_dir=${ZK0_CHECK_TARGET_DIR:-${CARGO_TARGET_DIR:-$root/target}/check-targets}
wasm=wasm32-unknown-unknown
guest=riscv64im-succinct-zkvm-elf

fail() { echo "check-targets: $2" >&2; exit "$1"; }

# Exits with 2, and says what to install, where there is no toolchain for guests.
toolchain=$("$root/circuits/build-guest.sh" --toolchain) || exit $?
case $toolchain in
debian:*)
    rustc=/usr/bin/rustc cargo=/usr/bin/cargo
    # The standard library is compiled from the sysroot's sources.
    std=(-Z build-std=std,panic_abort)
    wasm_options=(--target "$wasm" "${std[@]}")
    guest_options=(--target "$root/circuits/guest/$guest.json" -Z json-target-spec "${std[@]}"
        -Z build-std-features=compiler-builtins-mem)
    guest_rustc=$rustc
    ;;
succinct:*)
    rustc=$(command -v rustc) cargo=$(command -v cargo)
    [ -d "$("$rustc" --print sysroot)/lib/rustlib/$wasm" ] ||
        fail 2 "the target $wasm is not installed: run 'rustup target add $wasm'"
    wasm_options=(--target "$wasm")
    guest_options=(--target "$guest")
    guest_rustc=$(RUSTUP_TOOLCHAIN=succinct rustc --print sysroot)/bin/rustc
    ;;
*) fail 1 "build-guest.sh names a toolchain that this script does not know: $toolchain" ;;
esac

# Flags and wrappers of the surrounding environment are for the host.
unset RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_BUILD_TARGET RUSTC_WRAPPER RUSTUP_TOOLCHAIN RUSTC CARGO

# check NAME RUSTC FLAGS ARGUMENTS...
check() {
    local name=$1 compiler=$2 flags=$3
    shift 3
    echo "check-targets: $name" >&2
    (cd "$root" && RUSTC=$compiler RUSTC_BOOTSTRAP=1 RUSTFLAGS=$flags "$cargo" check --locked --target-dir "$target_dir" "$@") ||
        fail 1 "$name does not compile (see above)"
}

check "zk0-protocol for SP1's guest" "$guest_rustc" '--cfg getrandom_backend="custom" -C passes=lower-atomic -C panic=abort' \
    -p zk0-protocol "${guest_options[@]}"
check "zk0-protocol and zk0-verifier for browsers" "$rustc" '--cfg getrandom_backend="wasm_js"' \
    -p zk0-protocol -p zk0-verifier "${wasm_options[@]}"
echo "check-targets: zk0-protocol and zk0-verifier compile for browsers, and zk0-protocol for SP1's guest"
