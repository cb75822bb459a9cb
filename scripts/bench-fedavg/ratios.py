"""Prints one JSON line per figure of FedAvg, ours beside Flower's. A ratio above 1 says that ours is better.

usage: ratios.py LINES, where LINES are what bench_fedavg and flower_side.py have printed
"""

import json
import statistics
import sys

lines = [json.loads(line) for line in open(sys.argv[1]) if line.startswith("{")]
of = lambda side, key: statistics.median(line[key] for line in lines if line["side"] == side and key in line)


def figure(bench, ours, peer, ratio, unit):
    print(json.dumps({"bench": bench, "ours": round(ours, 3), "peer": round(peer, 3), "ratio": round(ratio, 3), "unit": unit}))


updates, weights = of("ours", "updates"), of("ours", "weights")
name = f"FedAvg of {updates:.0f} x {weights / 1e6:.1f} M weights"
seconds, written, flower, apart = (
    of("ours", "seconds"),
    of("ours", "with_writing_seconds"),
    of("flower", "seconds"),
    of("flower", "averaging_seconds"),
)
figure(f"{name}, wall time", seconds, flower, flower / seconds, "s")
figure(f"{name}, ours also written to a file", written, flower, flower / written, "s")
figure(f"{name}, ours beside Flower's averaging alone", seconds, apart, apart / seconds, "s")
gib = lambda side: of(side, "peak_memory_bytes") / 2**30
figure(f"{name}, peak memory", gib("ours"), gib("flower"), gib("flower") / gib("ours"), "GiB")
machine = of("machine", "bytes_per_second") / 1e9
for side in ("averaging", "averaging and rounding"):
    average = of(side, "bytes_per_second") / 1e9
    figure(f"{name}, {side} beside reading memory", average, machine, average / machine, "GB/s")
