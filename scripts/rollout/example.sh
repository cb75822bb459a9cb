#!/usr/bin/env bash
# From demonstrations to a rollout of a policy that comes from a ledger: what docs/rollout.md describes.
#
#   scripts/rollout/example.sh ZK0 FOLDER
#
# ZK0 is the program. FOLDER is made; steps whose results are there are left out. EPISODES, STEPS and ROLLOUTS choose sizes. The network of the example
# has one round, to which nobody contributes, because a proof takes minutes: `zk0 train` trains the policy before.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
zk0=$(readlink -f "$1") out=$2
venv=$HOME/.cache/zk0/rollout/venv
export HF_HUB_OFFLINE=1

"$here/../python-env" "$venv" "$here/requirements.txt"
run() { "$venv/bin/python" "$here/$@"; }
mkdir -p "$out" && cd "$out"
[ -f small/policy/model.safetensors ] || run small_policy.py small
[ -f recording.done ] || { rm -rf recording && run record.py recording --episodes "${EPISODES:-60}" && touch recording.done; }
[ -d run/lerobot ] || "$zk0" train --policy small/policy --dataset recording --steps "${STEPS:-6000}" --batch-size 32 --lr 1e-3 --eval-episodes 0.1 --out run

if [ ! -d network ]; then
    [ -f log.key ] || "$zk0" aggregator keygen log.key
    "$zk0" aggregator rules | python3 -c 'import json, sys; print(json.dumps(json.load(sys.stdin) | {"commit_window_ms": 1000, "max_update_bytes": 1 << 22}))' >rules.json
    "$zk0" aggregator init network --name rollout-example --key log.key --policy run/lerobot --rules rules.json --rules-never-change --mode succinct
fi
if [ ! -d round-0 ]; then
    "$zk0" aggregator serve network --key log.key --listen 127.0.0.1:0 --min-nodes 0 --rounds 1 2>>aggregator.log &
    aggregator=$!
    trap 'kill $aggregator 2>/dev/null || true' EXIT
    until "$zk0" audit show network --round 0 2>/dev/null | grep -q 'round 0 closed'; do
        kill -0 $aggregator
        sleep 1
    done
    kill $aggregator && wait $aggregator || true
    "$zk0" export lerobot network --round 0 --policy run/lerobot --out round-0
fi
"$zk0" export check round-0 network
[ -f trained/results.json ] || run rollout.py round-0 trained --episodes "${ROLLOUTS:-50}"
[ -f expert/results.json ] || run rollout.py expert expert --episodes "${ROLLOUTS:-50}"
"$zk0" audit replay network --html report.html --rollouts trained --rollouts expert
