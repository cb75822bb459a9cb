#!/usr/bin/env bash
# What the services do after the machine has restarted. run.sh runs it in its container.
. scripts/try-units/checks.sh

come_up_again() {
    within 20 answers
    [ "$(entries)" -ge "$(cat /root/entries)" ]
    local service
    for service in aggregator prover node witness; do
        within 20 systemctl is-active --quiet zk0-$service
    done
}

started() { property "$1" ExecMainStartTimestampMonotonic; }

start_in_order() {
    [ "$(started prover)" -lt "$(started node)" ]
}

be_whole() {
    systemctl stop zk0-node zk0-prover zk0-witness zk0-aggregator
    sudo -u zk0-aggregator zk0 ledger fsck /var/lib/zk0-aggregator/ledger
}

step 'all services come up again, and the ledger has all entries' come_up_again
step 'the node starts after the proving service' start_in_order
step 'the ledger is whole' be_whole
exit $failed
