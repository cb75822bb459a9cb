#!/usr/bin/env bash
# Builds the prototype's guest program with Debian's toolchain and prints where the ELF lies. The flags are those of
# circuits/build-guest.sh, which explains them.
#
# Environment: CARGO_TARGET_DIR, where to build (default: target beside this script).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd -P)
target=$here/../../circuits/guest/riscv64im-succinct-zkvm-elf.json
target_dir=${CARGO_TARGET_DIR:-$here/target}/guest
flags=(
    -C passes=lower-atomic -C link-arg=--image-base=2013265920 -C panic=abort
    --cfg 'getrandom_backend="custom"'
    -C llvm-args=-misched-prera-direction=bottomup -C llvm-args=-misched-postra-direction=bottomup
)
cd "$here/guest"
env -u RUSTFLAGS -u RUSTUP_TOOLCHAIN CARGO_ENCODED_RUSTFLAGS="$(IFS=$'\x1f'; echo "${flags[*]}")" RUSTC=/usr/bin/rustc \
    RUSTC_BOOTSTRAP=1 CARGO_INCREMENTAL=0 /usr/bin/cargo build --release --locked --target-dir "$target_dir" \
    --target "$target" -Z json-target-spec -Z build-std=std,panic_abort -Z build-std-features=compiler-builtins-mem >&2
echo "$target_dir/riscv64im-succinct-zkvm-elf/release/succinct"
