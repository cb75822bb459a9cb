"""Prints one JSON line per figure from the lines that both sides wrote: ratios above 1 are in our favour."""

import json
import statistics
import sys

lines = [json.loads(line) for line in open(sys.argv[1]) if line.startswith("{")]


def figure(name, ours, theirs, ratio, unit):
    print(json.dumps({"bench": name, "ours": round(ours, 3), "peer": round(theirs, 3), "ratio": round(ratio, 2), "unit": unit}))


for line in lines:
    if line["side"] != "zk0":
        continue
    same = [peer for peer in lines if peer["side"] == "lerobot" and (peer["profile"], peer["batch"]) == (line["profile"], line["batch"])]
    name = f"train/{line['profile']}/batch-{line['batch']}/{line['what']}"
    seconds = statistics.mean(peer["step_seconds"] for peer in same)
    figure(name, line["batch"] / line["step_seconds"], line["batch"] / seconds, seconds / line["step_seconds"], "samples/s")
    if line["peak_memory_bytes"] is None:
        continue
    memory = min(peer["peak_memory_bytes"] for peer in same)
    figure(f"{name}/memory", line["peak_memory_bytes"] / 2**30, memory / 2**30, memory / line["peak_memory_bytes"], "GiB")
