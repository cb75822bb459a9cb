#!/usr/bin/env bash
# Installs what building zk0 needs and is missing here: system packages, and a Rust toolchain where there is none recent
# enough. Debian and Ubuntu; asks for sudo when not root. `setup.sh guest` also installs what tests want besides (what
# rebuilds the guest program, Go and strace), `setup.sh cuda` what scripts/with-cuda needs, `setup.sh python` what scripts/python-env
# does.
set -euo pipefail

packages=(gcc g++ make pkg-config git protobuf-compiler libprotobuf-dev clang libclang-dev cmake nasm)
here=$(dirname "$(readlink -f "$0")")

install() {
    local missing=() package
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
    "${sudo[@]}" apt-get update -qq
    "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

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
        curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -y --profile minimal
    fi
    "$here/with-rust" true
fi

if [ "${1:-}" = guest ]; then
    # The guest is rebuilt with Debian's compiler; without it the check says that it did not run.
    install rustc-web cargo-web rust-web-src lld ||
        echo "setup: Debian's rustc-web is not to be had here; the guest program will not be rebuilt" >&2
    # Go's own implementation verifies our log's checkpoints and proofs; without it that test says that it did not.
    install golang-go golang-golang-x-mod-dev ||
        echo "setup: Go is not to be had here; only our own code will verify the log's formats" >&2
    # Tests kill the ledger's writer at each of its writes, and fail them; without it they say that they did not.
    install strace || echo "setup: strace is not to be had here; the ledger's writes will not be failed" >&2
fi

if [ "${1:-}" = python ] || { [ "${1:-}" = cuda ] && ! command -v nvcc >/dev/null; }; then
    python3 -c 'import ensurepip, venv' 2>/dev/null || install python3 python3-venv
fi
