#!/usr/bin/env bash
# Starts the units of packaging/ under a systemd of their own, by the commands of docs/services.md, and checks what that page says of them.
#
#   scripts/try-units/run.sh ZK0
#   scripts/try-units/run.sh DEB
#
# ZK0 is the program, and DEB the Debian package, which is installed, upgraded over a running service, and removed. A minimal Debian is made in a temporary folder (300 MB are fetched, 600 MB are on disk), booted in a container that reaches no
# network, and removed at the end. It prints a line for each step. The exit code is 0 if all went well, and 1 otherwise. It needs root, debootstrap
# and systemd-nspawn; SUITE chooses the release of Debian, and DEBIAN names a folder of it that is there already and stays.
set -euo pipefail

given=$(readlink -f "$1")
case $given in
    *.deb) place=/root/zk0.deb ;;
    *) place=/root/.cache/zk0/target/release/zk0 ;;
esac
here=$(readlink -f "$(dirname "$0")")
repository=$(readlink -f "$here/../..")
if [ "$(id -u)" != 0 ]; then
    echo "try-units: this makes a container, so it has to run as root: sudo $0 $given" >&2
    exit 1
fi
free=$(awk '/^MemAvailable:/{print int($2 / 1048576)}' /proc/meminfo)
if [ "$free" -lt 20 ] && [ $place != /root/zk0.deb ]; then
    echo "try-units: the proving service needs 20 GiB of free memory to start, and $free GiB are free: close other programs" >&2
    exit 1
fi

# systemd needs a hierarchy of control groups of version 2, and the container gets a group of its own there. In a mount namespace of its own, this
# script sees one at the usual place, whatever the machine itself has there. Nobody else sees the mounts, and they end with the script.
if [ -z "${UNITS_NAMESPACE:-}" ]; then
    UNITS_NAMESPACE=1 exec unshare --mount --propagation private "$0" "$given"
fi
mount -t cgroup2 cgroup2 /sys/fs/cgroup
group=/sys/fs/cgroup/zk0-units-$$
mkdir "$group"
outside=/sys/fs/cgroup$(cut -d: -f3 <(grep '^0::' /proc/self/cgroup))
echo $$ >"$group/cgroup.procs"

work=$(mktemp -d)
debian=${DEBIAN:-$work/debian}
root=$work/root
container=
finish() {
    if [ -n "$container" ]; then
        # systemd-nspawn ends the container in order when it gets SIGTERM.
        kill "$container" 2>/dev/null && wait "$container" 2>/dev/null || true
    fi
    echo $$ >"$outside/cgroup.procs"
    find "$group" -depth -type d -exec rmdir {} \; 2>/dev/null || true
    ! mountpoint --quiet "$root" || umount "$root"
    rm -rf --one-file-system "$work"
}
trap finish EXIT
trap 'exit 1' INT TERM

if [ ! -e "$debian/etc/os-release" ]; then
    echo "making a Debian in $debian" >&2
    debootstrap --variant=minbase --include=systemd-sysv,dbus,sudo,iproute2 "${SUITE:-trixie}" "$debian" >"$work/debootstrap.log" ||
        { tail -n 20 "$work/debootstrap.log" >&2; exit 1; }
fi

# What the container writes goes into an overlay, so that the Debian stays as it is.
mkdir "$work"/{upper,overlay,root}
mount -t overlay -o "lowerdir=$debian,upperdir=$work/upper,workdir=$work/overlay" overlay "$root"
echo zk0-units >"$root/etc/hostname"
echo '127.0.0.1 localhost zk0-units' >"$root/etc/hosts"

# Runs a command in the container, in the folder of the repository. The container's first process is a child of systemd-nspawn.
inside() {
    nsenter --target "$(pgrep --parent "$container")" --all --root --wdns=/root/zk0 -- \
        env --ignore-environment HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
}

# Boots the container, and waits until it runs. The repository, and the program or the package, are where the steps look for them. IPAddressDeny of the prover's unit
# is a BPF program, so the container may load such programs, which systemd-nspawn does not allow by itself.
boot() {
    local state
    systemd-nspawn --quiet --boot --register=no --keep-unit --machine=zk0-units --directory="$root" --private-network --capability=all \
        --system-call-filter=bpf --console=read-only --bind-ro="$repository:/root/zk0" --bind-ro="$given:$place" >"$work/console.log" 2>&1 </dev/null &
    container=$!
    for _ in $(seq 120); do
        state=$(inside systemctl is-system-running 2>/dev/null) || true
        case $state in running | degraded) return ;; esac
        sleep 1
    done
    echo "try-units: the container did not boot; its console says:" >&2
    tail -n 30 "$work/console.log" >&2
    exit 1
}

boot
inside systemctl --version | head -n 1
failed=0
if [ $place = /root/zk0.deb ]; then
    inside scripts/try-units/package.sh || failed=1
    exit $failed
fi
inside scripts/try-units/steps.sh || failed=1
# systemd-nspawn ends when its container restarts, and leaves it to its caller to boot it again.
inside systemctl reboot
wait "$container" || true
boot
inside scripts/try-units/after-restart.sh || failed=1
exit $failed
