#!/usr/bin/env bash
# Installs zk0 with its settings and its systemd units.
#
#   packaging/install.sh BINARY [ROOT]
#
# ROOT is / by default. Settings that are there already are kept. Nothing is started, and no user is made: docs/services.md says what comes next.
set -euo pipefail

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    echo "install: usage: packaging/install.sh BINARY [ROOT]" >&2
    exit 2
fi
binary=$1
root=${2:-}
root=${root%/}
here=$(dirname "$(readlink -f "$0")")

if [ ! -x "$binary" ]; then
    echo "install: $binary is not a program: build it with 'make build', which says where it is" >&2
    exit 1
fi
install -D -m 755 "$binary" "$root/usr/local/bin/zk0"
install -d -m 755 "$root/etc/zk0"
for settings in "$here"/config/*.toml; do
    to=$root/etc/zk0/$(basename "$settings")
    [ -e "$to" ] || install -m 644 "$settings" "$to"
done
for unit in "$here"/systemd/*.service; do
    install -D -m 644 "$unit" "$root/etc/systemd/system/$(basename "$unit")"
done
install -D -m 644 "$here/systemd/zk0-users.conf" "$root/etc/sysusers.d/zk0.conf"
echo "installed zk0 in $root/usr/local/bin, its settings in $root/etc/zk0, and its units in $root/etc/systemd/system"
