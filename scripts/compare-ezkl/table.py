"""Prints the results of both sides as one Markdown table."""

import json
import sys
from pathlib import Path

SIDES = [("zk0", "direct"), ("zk0", "succinct"), ("ezkl", None)]
NAMES = {("zk0", "direct"): "zk0 `direct`", ("zk0", "succinct"): "zk0 `succinct`", ("ezkl", None): "EZKL"}


def row(name, line):
    if "prove_seconds" not in line:
        why = line["failed"] if isinstance(line["failed"], str) else json.dumps(line["failed"])
        return [name, *(["–"] * 3), "–", "–", f"no longer fits: {why}" if line.get("no_longer_fits") else why]
    return [
        name,
        f"{line['setup_seconds']:.0f}",
        f"{line['prove_seconds']:.0f}",
        f"{line['verify_seconds']:.2f}",
        f"{line['proof_bytes'] / 1e6:.2f}",
        f"{line['peak_memory_bytes'] / 2**30:.1f}",
        f"{line['cycles'] / 1e6:.2f} M cycles" if "cycles" in line else f"2^{line['logrows']} rows",
    ]


def main():
    lines = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()]
    found = {(line["side"], line.get("mode"), line["model"]): line for line in lines}
    models = list(dict.fromkeys(line["model"] for line in lines))
    weights = {line["model"]: line["weights"] for line in lines if "weights" in line}
    print("| model, weights | side | set-up, s | prove, s | verify, s | proof, MB | memory, GiB | size |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for model in models:
        for side in SIDES:
            line = found.get((*side, model))
            if line:
                print("| " + " | ".join([f"{model}, {weights.get(model, 0):,}", *row(NAMES[side], line)]) + " |")


if __name__ == "__main__":
    main()
