"""Prints one JSON line per figure from what both sides and measured.py wrote into a file: ratios above 1 are in our favour."""

import json
import statistics
import sys
from pathlib import Path

lines = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines() if line.startswith("{")]
seconds, memory = {}, {}
for line in lines:
    if "case" in line:
        seconds.setdefault((line["case"], line["side"]), []).append(line["each"])
    else:
        memory.setdefault(line["run"], []).append(line["bytes"] / 2**20)


def figure(name, ours, peer, ratio, unit):
    print(json.dumps({"bench": f"decode/{name}", "ours": round(ours, 1), "peer": peer and round(peer, 1), "ratio": ratio and round(ratio, 2), "unit": unit}))


for (case, side), ours in seconds.items():
    if side != "zk0":
        continue
    # LeRobot has no check of its own: reading all pictures in order is the same work.
    peers = seconds.get((case.replace("validate", "in-order"), "lerobot"))
    # The sides ran in turn, and the median is that of the ratios.
    ratio = peers and statistics.median(theirs / own for own, theirs in zip(ours, peers))
    own, theirs = statistics.median(ours), peers and statistics.median(peers)
    if case.endswith(":open"):
        figure(case, own * 1000, theirs * 1000, ratio, "ms")
    else:
        figure(case, 1 / own, theirs and 1 / theirs, ratio, "frames/s")
# The comparison that is hardest on us.
least = min(memory["lerobot"])
for case, ours in memory.items():
    if case != "lerobot":
        figure(f"{case}/memory", max(ours), least, least / max(ours), "MiB")
