#!/usr/bin/env bash
# Builds the SP1 guest programs from source.
#
#   circuits/build-guest.sh            build, and replace the committed ELFs. The record beside them (verifying key, digest,
#                                      toolchain) is then out of date until the example record_guest of zk0-prover has
#                                      renewed it, as `make guest` does.
#   circuits/build-guest.sh --check    build, and compare with the committed ELFs
#   circuits/build-guest.sh --budget FOLDER   build the programs so that they report the cycles of each operation (not for proofs), and
#                                      write their ELFs to FOLDER
#   circuits/build-guest.sh --toolchain  print the toolchain that would be used, as the record names it
#
# Two toolchains will do, and the first one found is used unless ZK0_GUEST_TOOLCHAIN names one:
#   debian    /usr/bin/rustc and /usr/bin/cargo with the standard library's sources in the sysroot, and ld.lld
#             (Debian: rustc-web cargo-web rust-web-src lld); the standard library is compiled along
#   succinct  SP1's own, as `sp1up` installs it
# Different compilers give different ELFs, hence different verifying keys: only one built by the recorded toolchain can be
# compared byte for byte.
#
# Environment: ZK0_GUEST_TARGET_DIR, where to build (default: circuits/guest/target).
#
# Exit code: 0 done (--check: equal), 1 failed (--check: different), 2 the toolchain needed is not installed.
set -euo pipefail

circuits=$(cd "$(dirname "$0")" && pwd -P)
guest=$circuits/guest
target=riscv64im-succinct-zkvm-elf
target_dir=${ZK0_GUEST_TARGET_DIR:-$guest/target}
programs=(direct succinct)

fail() { echo "build-guest: $2" >&2; exit "$1"; }

# --- which toolchain -----------------------------------------------------------------------------------------------------

has_debian() {
    [ -x /usr/bin/rustc ] && [ -x /usr/bin/cargo ] && command -v ld.lld >/dev/null &&
        [ -f "$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/Cargo.lock" ]
}
has_succinct() { RUSTUP_TOOLCHAIN=succinct rustc --version >/dev/null 2>&1; }

kind=${ZK0_GUEST_TOOLCHAIN:-}
if [ -z "$kind" ]; then
    if has_debian; then kind=debian; elif has_succinct; then kind=succinct; else
        fail 2 "no toolchain for SP1 guests here: install Debian's rustc-web cargo-web rust-web-src lld, or run sp1up"
    fi
fi
case $kind in
debian)
    has_debian || fail 2 "Debian's guest toolchain is not complete: install rustc-web cargo-web rust-web-src lld"
    rustc=/usr/bin/rustc cargo=/usr/bin/cargo
    linker=$(ld.lld --version)
    # A custom target, whose standard library is compiled from the sysroot's sources.
    target_options=(--target "$guest/$target.json" -Z json-target-spec -Z build-std=std,panic_abort
        -Z build-std-features=compiler-builtins-mem)
    ;;
succinct)
    has_succinct || fail 2 "the rustup toolchain 'succinct' is not installed: run sp1up"
    rustc=$(RUSTUP_TOOLCHAIN=succinct rustc --print sysroot)/bin/rustc cargo=cargo
    linker="the toolchain's own"
    target_options=(--target "$target")
    ;;
*) fail 2 "ZK0_GUEST_TOOLCHAIN is '$kind'; it can be debian or succinct" ;;
esac
release=$("$rustc" -vV | sed -n 's/^release: //p')
commit=$("$rustc" -vV | sed -n 's/^commit-hash: //p')
toolchain="$kind: rustc $release ($commit), linker $linker"

if [ "${1:-}" = --toolchain ]; then echo "$toolchain"; exit 0; fi
features=()
case ${1:-} in
'' | --check) ;;
--budget)
    [ -n "${2:-}" ] || fail 1 "--budget wants the folder to write to"
    features=(--features budget)
    ;;
*) fail 1 "unknown argument '$1' (see the head of this script)" ;;
esac

# --- the build -----------------------------------------------------------------------------------------------------------

# What sp1-build 6.10 passes, and after it: loops unrolled, which saves a tenth of the cycles; no source lines in panics, so
# that moving a line in a source does not give another verifying key; and no paths of this machine.
flags=(
    -C passes=lower-atomic
    -C link-arg=--image-base=2013265920
    -C panic=abort
    --cfg 'getrandom_backend="custom"'
    -C llvm-args=-misched-prera-direction=bottomup
    -C llvm-args=-misched-postra-direction=bottomup
    -C llvm-args=-unroll-runtime=true
    -Z location-detail=none
    "--remap-path-prefix=$target_dir=/target"
    "--remap-path-prefix=$circuits=/zk0/circuits"
    "--remap-path-prefix=${circuits%/*}/argument=/zk0/argument"
    "--remap-path-prefix=$("$rustc" --print sysroot)=/rust"
)
for registry in "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*; do flags+=("--remap-path-prefix=$registry=/crates"); done

# Flags, wrappers and profiles of the surrounding environment must not change the result.
for name in $(compgen -e | grep -E '^(CARGO_(ENCODED_RUSTFLAGS|BUILD_|PROFILE_|TARGET_|FEATURE_|CFG_)|RUSTFLAGS$|RUSTC_)'); do
    unset "$name"
done
unset RUSTUP_TOOLCHAIN RUSTC CARGO

# build PROGRAM [CARGO OPTION…]
build() {
    local program=$1
    shift
    (
        cd "$guest"
        CARGO_ENCODED_RUSTFLAGS=$(IFS=$'\x1f'; echo "${flags[*]}") RUSTC=$rustc RUSTC_BOOTSTRAP=1 CARGO_INCREMENTAL=0 \
            RUSTC_WRAPPER=$guest/rustc-wrapper \
            "$cargo" build --release --locked --target-dir "$target_dir" "${target_options[@]}" --bin "$program" "$@"
    ) >&2 || fail 1 "the build of $program failed (see above)"
}
build direct "${features[@]}"
build succinct "${features[@]}" --features bump

# --- the result ----------------------------------------------------------------------------------------------------------

if [ "${1:-}" = --budget ]; then
    mkdir -p "$2"
    for program in "${programs[@]}"; do install -m 644 "$target_dir/$target/release/$program" "$2/$program.elf"; done
    exit 0
fi
status=0
for program in "${programs[@]}"; do
    built=$target_dir/$target/release/$program
    committed=$circuits/elf/$program.elf
    digest=$(sha256sum <"$built" | cut -d' ' -f1)
    if [ "${1:-}" != --check ]; then
        mkdir -p "$circuits/elf"
        install -m 644 "$built" "$committed"
        echo "$program.elf: SHA-256 $digest, built with $toolchain"
    elif cmp -s "$built" "$committed"; then
        echo "$program.elf: equal to what the sources give (SHA-256 $digest)"
    elif grep -qF "\"toolchain\": \"$toolchain\"" "$circuits/elf/$program.json"; then
        echo "$program.elf: the sources give SHA-256 $digest, committed is $(sha256sum <"$committed" | cut -d' ' -f1)" >&2
        status=1
    else
        echo "$program.elf: cannot be compared. Recorded toolchain: $(sed -n 's/^ *"toolchain": "\(.*\)",\{0,1\}$/\1/p' \
            "$circuits/elf/$program.json"); installed: $toolchain" >&2
        [ $status = 1 ] || status=2
    fi
done
exit $status
