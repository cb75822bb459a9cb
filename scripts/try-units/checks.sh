# What steps.sh and after-restart.sh share. They run in the container, as root, in the folder of the repository.
set -uo pipefail
failed=0
url=https://localhost:7071
trust=(--ca /etc/zk0/ca.pem)

# Runs a step, and prints whether each of its commands succeeded; if one did not, what they and the services said.
step() {
    local name=$1 began=$SECONDS said code
    shift
    said=$(mktemp)
    (set -ex; "$@") >"$said" 2>&1
    code=$?
    if [ $code = 0 ]; then
        echo "ok      $name ($((SECONDS - began)) s)"
    else
        failed=1
        echo "FAILED  $name"
        journalctl --quiet --lines 30 --output cat --unit 'zk0-*' >>"$said"
        sed 's/^/        /' "$said"
    fi
    rm "$said"
}

# Waits at most so many seconds until a command succeeds.
within() {
    local seconds=$1
    shift
    { set +x; } 2>/dev/null
    for _ in $(seq "$((seconds * 4))"); do
        if "$@" >/dev/null 2>&1; then
            set -x
            return
        fi
        sleep 0.25
    done
    set -x
    "$@"
}

# `set -e` does not see what follows a `!`.
refused() { ! "$@"; }

# One property of a unit, such as NRestarts.
property() { systemctl show --value --property "$2" "zk0-$1"; }

# Whether the log of a service, since it was last started, has these words.
logged() { journalctl --quiet --output cat "_SYSTEMD_INVOCATION_ID=$(property "$1" InvocationID)" | grep --quiet -- "$2"; }

# How many entries the ledger has, as the running aggregator says.
entries() {
    zk0 status --aggregator $url "${trust[@]}" --network "$(cat /root/network)" --json | sed -n 's/.*"entries":\([0-9]*\).*/\1/p'
}

answers() { [ -n "$(entries)" ]; }
