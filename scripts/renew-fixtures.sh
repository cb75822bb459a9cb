#!/usr/bin/env bash
# Runs a demo, and makes its ledger and a proof from it the fixtures that fast tests and later demos use. The demo's picture is that of
# docs/demo.md. The keys of the network are kept, too: with them, tests let its nodes commit again, and its proofs are proofs once more.
set -euo pipefail
zk0=$1
fixtures=tests/fixtures
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# Where there is no proof to steal yet, the lazy node passes off something else.
stolen=$fixtures/proof.bin
[ -e "$stolen" ] || stolen=circuits/elf/direct.elf
"$zk0" demo --out "$out" --stolen-proof "$stolen"

results=$(echo "$out"/*)
if [ "$(grep -c '"accepted": true' "$results/metrics.json")" -lt 2 ]; then
    echo "renew-fixtures: fewer than two contributions were accepted, and the tests need a round that averages, so the fixtures stay as they are:" \
        "run this again with nothing beside it" >&2
    exit 1
fi
accepted=$(grep -A20 '"accepted": true' "$results/metrics.json" | sed -n 's/.*"proof": "\([0-9a-f]*\)".*/\1/p' | head -n 1)
rm -rf "$fixtures/ledger" "$fixtures/export" "$fixtures/keys" "$fixtures/node-1"
cp -r "$results/network" "$fixtures/ledger"
# RocksDB's own log and lock are not part of the ledger, and name this machine's folders.
rm -f "$fixtures"/ledger/log/LOG* "$fixtures"/ledger/log/LOCK
# What the ledger publishes. Its blobs are the ledger's own.
"$zk0" ledger export "$results/network" "$fixtures/export"
rm -r "$fixtures/export/blobs"
ln -s ../ledger/blobs "$fixtures/export/blobs"
cp "$results/network/blobs/sha256/$accepted" "$fixtures/proof.bin"
cp "$results/loss.png" docs/demo.png

# What the network and its first node need to play the round again. Nobody else may use this network: everybody knows its keys.
mkdir "$fixtures/keys" "$fixtures/node-1"
cp "$results/log.key" "$fixtures/keys"
for node in "$results"/nodes/*; do
    cp "$node/node.key" "$fixtures/keys/$(basename "$node").key"
done
cp -r "$results"/nodes/node-1/secret "$results"/nodes/node-1/evaluation-set-* "$fixtures/node-1"
