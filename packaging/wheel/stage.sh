#!/usr/bin/env bash
# Puts what the wheel `zk0` holds into FOLDER/zk0-VERSION, for `wheel pack`. The program becomes the command `zk0`.
#
#   packaging/wheel/stage.sh BINARY FOLDER
set -euo pipefail

if [ $# != 2 ]; then
    echo "stage: usage: packaging/wheel/stage.sh BINARY FOLDER" >&2
    exit 2
fi
binary=$1
here=$(dirname "$(readlink -f "$0")")
root=$here/../..
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"/\1/p' "$root/Cargo.toml")

if [ ! -x "$binary" ]; then
    echo "stage: $binary is not a program: build it with 'make build', which says where it is" >&2
    exit 1
fi
wheel=$2/zk0-$version
info=$wheel/zk0-$version.dist-info
install -D -m 755 "$binary" "$wheel/zk0-$version.data/scripts/zk0"
install -D -m 644 -t "$info/licenses" "$root/LICENSE-APACHE" "$root/LICENSE-MIT"
sed "s/^Version: VERSION$/Version: $version/" "$here/METADATA" >"$info/METADATA"
install -m 644 "$here/WHEEL" "$info/WHEEL"
echo "$wheel"
