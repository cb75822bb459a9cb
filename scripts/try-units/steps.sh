#!/usr/bin/env bash
# What an operator does by docs/services.md with a new machine, and what that page promises. run.sh runs it in its container.
. scripts/try-units/checks.sh

recording=tests/fixtures/datasets/so100_pickplace
alice=$(zk0=/root/.cache/zk0/target/release/zk0 && $zk0 node keygen /root/alice.key)

# The commands of block NUMBER below a heading of the page, with what a reader fills in. `sudoedit` runs sed with the script /root/edits.
documented() {
    awk -v wanted="$1" '/^## /{here = /How does systemd run them/} here && /^```sh/{count++; shown = count == wanted; next} /^```/{shown = 0} shown' \
        docs/services.md | sed -e '/^make build/d' -e "s/IDENTITY/$alice/g" -e "s|my_recording|$recording|" >/root/commands
    [ -s /root/commands ]
    SUDO_EDITOR='sed -i -f /root/edits' bash -ex /root/commands
}

found_the_aggregator() {
    echo 's/^#log-listen/log-listen/' >/root/edits
    documented 1
    documented 2
    within 10 logged aggregator 'listens on'
    sed -n 's/.*the aggregator of network \([0-9a-f]*\).*/\1/p' <(journalctl -u zk0-aggregator -o cat) >/root/network
    zk0 status --aggregator http://127.0.0.1:7071 --network "$(cat /root/network)"
    journalctl -u zk0-aggregator -o cat | grep 'listens on'
    refused grep $'\x1b' <(journalctl -u zk0-aggregator -o cat --all)
}

belongs() { [ "$(stat -c '%U %a' "$2")" = "$1" ]; }

keys_belong_to_their_services() {
    belongs 'zk0-aggregator 600' /etc/zk0/log.key
    belongs 'zk0-aggregator 700' /var/lib/zk0-aggregator
    refused sudo -u zk0-node cat /etc/zk0/log.key
    refused sudo -u zk0-prover ls /var/lib/zk0-aggregator
}

encrypt() {
    rm -rf /root/tls
    zk0 aggregator certificate /root/tls --name localhost
    install -m 644 /root/tls/ca.pem /etc/zk0/ca.pem
    install -m 600 -o zk0-aggregator /root/tls/server.key /etc/zk0/privkey.pem
    install -m 644 /root/tls/server.pem /etc/zk0/fullchain.pem
}

take_more_settings() {
    encrypt
    sed -i -e 's/^#\(tls-certificate\|tls-key\|metrics\)/\1/' -e 's|^#blob-store =.*|blob-store = "file:///var/lib/zk0-aggregator/store"|' \
        -e 's|^#listen =.*|listen = "0.0.0.0:7071"|' /etc/zk0/aggregator.toml
    echo 'ZK0_AGGREGATOR_MIN_NODES=1' >/etc/zk0/aggregator.env
    systemctl restart zk0-aggregator
    within 20 answers
    find /var/lib/zk0-aggregator/store -type f | grep .
    exec 3<>/dev/tcp/127.0.0.1/9071
    printf 'GET /metrics HTTP/1.0\r\n\r\n' >&3
    grep 'zk0_ledger_entries' <&3
}

renew_the_certificate() {
    encrypt
    within 15 logged aggregator 'new connections are shown the new certificate'
    answers
}

# What the unit of a service allows and forbids.
confined() {
    systemd-analyze security --no-pager --threshold=25 "zk0-$1" | tail -n 1
    install -m 755 scripts/try-units/forbidden.sh /usr/local/bin/forbidden
    mkdir -p -m 777 /srv/everybody /home/everybody /tmp/everybody
    # The service itself may be running: what it shares in memory stays.
    sed -e "s|^ExecStart=.*|ExecStart=/usr/local/bin/forbidden zk0-$1|" -e 's/^Type=.*/Type=oneshot/' -e '/^Restart=/d' -e '/^RemoveIPC=/d' \
        "/etc/systemd/system/zk0-$1.service" >/run/systemd/system/zk0-probe.service
    systemctl daemon-reload
    systemctl start zk0-probe
    refused sudo -u "zk0-$1" /usr/local/bin/forbidden "zk0-$1"
}

stop_and_start() {
    local before
    before=$(entries)
    stops aggregator
    systemctl start zk0-aggregator
    within 20 answers
    systemctl restart zk0-aggregator
    within 20 answers
    [ "$(entries)" -ge "$before" ]
}

be_killed() {
    local before
    before=$(entries)
    systemctl kill --signal=KILL --kill-whom=main zk0-aggregator
    sleep 3
    [ "$(property aggregator ActiveState)" = activating ]
    within 20 answers
    [ "$(property aggregator NRestarts)" = 1 ]
    [ "$(entries)" -ge "$before" ]
}

be_misspelt() {
    cp /etc/zk0/aggregator.toml /root/kept.toml
    echo 'min-nods = 3' >>/etc/zk0/aggregator.toml
    systemctl restart zk0-aggregator || true
    within 5 logged aggregator "aggregator.toml.*$(wc -l </etc/zk0/aggregator.toml).*min-nods"
    journalctl -u zk0-aggregator --grep 'WARN|ERROR|error:' | grep min-nods
    sleep 6
    [ "$(property aggregator ActiveState) $(property aggregator NRestarts)" = 'failed 0' ]
    cp /root/kept.toml /etc/zk0/aggregator.toml
    systemctl start zk0-aggregator
    within 20 answers
}

start_node_and_prover() {
    cat >/root/edits <<SED
s|^aggregator = .*|aggregator = "$url"|
s|^#ca = .*|ca = "/etc/zk0/ca.pem"|
s|^network = .*|network = "$(cat /root/network)"|
s|^#rounds = .*|rounds = 100|
SED
    # Other machines could reach this address, if it were not for the unit.
    ip address add 192.0.2.1/32 dev lo
    echo 'ZK0_PROVER_LISTEN=0.0.0.0:7072' >/etc/zk0/prover.env
    documented 3
    within 20 logged prover 'the proving service listens on'
}

reaches() { timeout 3 bash -c "exec 3<>/dev/tcp/$1/$2"; }

only_this_machine_reaches_the_prover() {
    reaches 192.0.2.1 7071
    reaches 127.0.0.1 7072
    refused reaches 192.0.2.1 7072
}

enrol_the_node() {
    within 20 logged node 'is not enrolled in this network'
    local identity
    identity=$(journalctl -u zk0-node -o cat | sed -n 's/.*node \([0-9a-f]*\) is not enrolled.*/\1/p' | head -n 1)
    zk0 aggregator enrol --aggregator $url --ca /etc/zk0/ca.pem --network "$(cat /root/network)" --key /etc/zk0/log.key --node "bob=$identity"
    within 120 logged node 'round 0: committed to update'
    within 120 logged prover 'the claim holds; queued'
}

# What the proving service began does not keep it from ending. The node asks again meanwhile, until it finds the service.
restart_the_prover() {
    stops prover
    systemctl start zk0-prover
    within 120 logged prover 'the claim holds; queued'
}

stops() {
    timeout 15 systemctl stop "zk0-$1"
    [ "$(property "$1" Result) $(property "$1" ActiveState)" = 'success inactive' ]
}

# A proof takes minutes and 20 GiB, so it is only begun.
begin_a_proof() {
    within 600 logged prover 'the prover is ready'
    sleep 20
    [ "$(property prover NRestarts) $(property prover ActiveState)" = '0 active' ]
    refused logged prover 'WARN request refused'
    stops node
    stops prover
}

start_a_witness() {
    cat >/root/edits <<SED
s|^log-key = .*|log-key = ["$(zk0 ledger vkey /var/lib/zk0-aggregator/ledger)"]|
SED
    documented 4
    within 20 logged witness 'the verifier key of this witness is witness.example/w1'
    within 20 reaches 127.0.0.1 7074
    belongs 'zk0-witness 600' /etc/zk0/witness.key
    stops witness
    systemctl start zk0-witness
}

step 'a network is founded, and the aggregator starts, answers and logs' found_the_aggregator
step 'keys and folders belong to their services' keys_belong_to_their_services
step 'the aggregator takes TLS, a blob store and metrics' take_more_settings
step 'a renewed certificate is taken without a restart' renew_the_certificate
step 'the aggregator cannot do what it need not do' confined aggregator
step 'the aggregator stops within its time, and restarts with its ledger' stop_and_start
step 'a killed aggregator is started again' be_killed
step 'a wrong setting is named, and not tried again' be_misspelt
step 'the proving service and the node start' start_node_and_prover
step 'only this machine reaches the proving service' only_this_machine_reaches_the_prover
step 'the node is enrolled, trains, commits and asks for a proof' enrol_the_node
step 'the proving service ends while SP1 starts, and the node finds it again' restart_the_prover
step 'the node cannot do what it need not do' confined node
step 'the proving service cannot do what it need not do' confined prover
step 'SP1 starts, begins a proof, and is ended' begin_a_proof
step 'a witness starts, and stops within its time' start_a_witness
step 'the witness cannot do what it need not do' confined witness
entries >/root/entries
exit $failed
