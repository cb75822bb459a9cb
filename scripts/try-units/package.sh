#!/usr/bin/env bash
# What the Debian package does on a new machine, over a running service, and when it is removed. run.sh runs it in its container.
. scripts/try-units/checks.sh
url=http://127.0.0.1:7071
trust=()
services=(aggregator node prover witness)
export DEBIAN_FRONTEND=noninteractive

# The container reaches no network, so what the package recommends stays away.
get() { apt-get install --yes --no-install-recommends "$@"; }

install_on_a_new_machine() {
    get /root/zk0.deb
    mkdir /root/empty
    env --ignore-environment HOME=/root/empty /usr/bin/zk0 audit replay tests/fixtures/export | grep VERIFIED
    [ -z "$(ls -A /root/empty)" ]
    local service
    for service in "${services[@]}"; do
        id "zk0-$service"
        [ "$(property "$service" LoadState) $(property "$service" ActiveState)" = 'loaded inactive' ]
        [ "$(property "$service" UnitFileState)" = disabled ]
    done
}

found_a_network() {
    local identity
    identity=$(zk0 node keygen /root/alice.key)
    install -d -o zk0-aggregator -m 700 /var/lib/zk0-aggregator
    zk0 aggregator keygen /etc/zk0/log.key
    chown zk0-aggregator /etc/zk0/log.key
    sudo -u zk0-aggregator zk0 aggregator init /var/lib/zk0-aggregator/ledger --name my-network --key /etc/zk0/log.key \
        --governor "me=$identity" --node "alice=$identity"
    sed -i 's/^#min-nodes/min-nodes/' /etc/zk0/aggregator.toml
    systemctl enable --now zk0-aggregator
    within 20 logged aggregator 'listens on'
    journalctl -u zk0-aggregator -o cat | sed -n 's/.*the aggregator of network \([0-9a-f]*\).*/\1/p' >/root/network
    within 20 answers
}

be_upgraded() {
    local before running
    before=$(entries)
    running=$(property aggregator InvocationID)
    dpkg-deb --raw-extract /root/zk0.deb /root/newer
    sed -i 's/^Version: .*/&.1/' /root/newer/DEBIAN/control
    dpkg-deb -Zgzip -z1 --root-owner-group --build /root/newer /root/newer.deb
    get /root/newer.deb
    [ "$(property aggregator InvocationID)" != "$running" ]
    # It ended in order, and was not killed.
    refused grep 'Failed with result\|Killing' <(journalctl -u zk0-aggregator -o cat)
    within 20 answers
    [ "$(property aggregator ActiveState) $(property aggregator UnitFileState)" = 'active enabled' ]
    [ "$(entries)" -ge "$before" ]
    grep '^min-nodes' /etc/zk0/aggregator.toml
    local service
    for service in node prover witness; do
        [ "$(property "$service" ActiveState) $(property "$service" UnitFileState)" = 'inactive disabled' ]
    done
}

name_what_counts_before_it() {
    packaging/install.sh /usr/bin/zk0
    get --reinstall /root/newer.deb >/root/output 2>&1
    local other=(/usr/local/bin/zk0 /etc/systemd/system/zk0-*.service) file
    for file in "${other[@]}"; do
        grep "$file counts before this package" /root/output
    done
    rm "${other[@]}"
    systemctl daemon-reload
}

keep_keys_and_ledger() {
    local log_key
    log_key=$(sha256sum /etc/zk0/log.key)
    entries >/root/entries
    apt-get remove --yes zk0
    [ "$(property aggregator ActiveState)" = inactive ]
    grep '^min-nodes' /etc/zk0/aggregator.toml
    apt-get purge --yes zk0
    refused ls /etc/zk0/aggregator.toml
    [ "$(sha256sum /etc/zk0/log.key)" = "$log_key" ]
    get /root/zk0.deb
    sudo -u zk0-aggregator zk0 ledger fsck /var/lib/zk0-aggregator/ledger
    systemctl start zk0-aggregator
    within 20 answers
    [ "$(entries)" -ge "$(cat /root/entries)" ]
}

step 'the package installs the program, users and units, and starts nothing' install_on_a_new_machine
step 'a network is founded, and the aggregator starts and answers' found_a_network
step 'an upgrade restarts the running service alone, with its ledger and its settings' be_upgraded
step 'a program of packaging/install.sh is named' name_what_counts_before_it
step 'keys and ledger stay when the package is removed and purged' keep_keys_and_ledger
exit $failed
