"""Prints one JSON line per figure from the lines that both sides wrote: ratios above 1 are in our favour."""

import json
import statistics
import sys

lines = [json.loads(line) for line in open(sys.argv[1]) if line.startswith("{")]


def figure(name, ours, theirs, ratio, unit):
    print(json.dumps({"bench": name, "ours": round(ours, 3), "peer": round(theirs, 3), "ratio": round(ratio, 2), "unit": unit}))


runs = {}
for line in lines:
    runs.setdefault((line["profile"], line["batch"], line.get("what") if line["side"] == "zk0" else "lerobot"), []).append(line)

for (profile, batch, what), ours in runs.items():
    peers = runs.get((profile, batch, "lerobot"), [])
    if what == "lerobot" or not peers:
        continue
    name = f"train/{profile}/batch-{batch}/{what}"
    own, seconds = (statistics.median(run["step_seconds"] for run in side) for side in (ours, peers))
    figure(name, batch / own, batch / seconds, seconds / own, "samples/s")
    if any(run["peak_memory_bytes"] is None for run in ours):
        continue
    # The comparison that is hardest on us.
    most, least = max(run["peak_memory_bytes"] for run in ours), min(run["peak_memory_bytes"] for run in peers)
    figure(f"{name}/memory", most / 2**30, least / 2**30, least / most, "GiB")
