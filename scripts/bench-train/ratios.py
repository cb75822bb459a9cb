"""Prints one JSON line per figure from the lines that both sides wrote: ratios above 1 are in our favour."""

import json
import sys

lines = [json.loads(line) for line in open(sys.argv[1])]
peers = {(line["profile"], line["batch"]): line for line in lines if line["side"] == "lerobot"}
for line in lines:
    if line["side"] != "zk0":
        continue
    peer = peers[line["profile"], line["batch"]]
    name = f"train/{line['profile']}/batch-{line['batch']}/{line['what']}"
    ours, theirs = (side["batch"] / side["step_seconds"] for side in (line, peer))
    print(json.dumps({"bench": name, "ours": round(ours, 3), "peer": round(theirs, 3), "ratio": round(ours / theirs, 2), "unit": "samples/s"}))
    ours, theirs = (side["peak_memory_bytes"] / 2**30 for side in (line, peer))
    print(json.dumps({"bench": f"{name}/memory", "ours": round(ours, 2), "peer": round(theirs, 2), "ratio": round(theirs / ours, 2), "unit": "GiB"}))
