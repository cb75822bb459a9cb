"""Prints the results of both sides as Markdown: one table of both, and one of the parts of zk0's mode `succinct`."""

import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SIDES = [("zk0", "direct"), ("zk0", "succinct"), ("ezkl", None)]
NAMES = {("zk0", "direct"): "zk0 `direct`", ("zk0", "succinct"): "zk0 `succinct`", ("ezkl", None): "EZKL"}
HEAD = "| model, weights | side | passes | set-up, s | prove, s | verify, s | proof, MB | memory, GiB | size |"
PARTS = "| model | native argument, s | its memory, GiB | guest cycles | SP1 proof, s | its memory, GiB | check of weights, s |"


def number(line, field, form, divisor=1):
    return format(line[field] / divisor, form) if field in line else "–"


def outcome(line):
    """What a line says besides numbers."""
    if "failed" in line:
        return f"no longer fits: {line['failed']}" if line.get("no_longer_fits") else line["failed"]
    size = f"2^{line['logrows']} rows" if "logrows" in line else ""
    if "cycles" in line:
        size = f"{line['cycles'] / 1e6:,.2f} M cycles"
    why = f"**not proven**: {line['not_proven']}" if "not_proven" in line else ""
    return "; ".join(part for part in (size, why) if part)


def prove(line):
    """All that comes before a proof is there: in mode `succinct`, the argument too."""
    if "prove_seconds" not in line:
        return "–"
    return f"{line.get('argument_seconds', 0) + line['prove_seconds']:.0f}"


def memory(line):
    peaks = [line[field] for field in ("peak_memory_bytes", "argument_peak_memory_bytes") if field in line]
    return f"{max(peaks) / 2**30:.1f}" if "prove_seconds" in line else "–"


def verify(line):
    if "verify_seconds" not in line:
        return "–"
    return f"{line['verify_seconds'] + line.get('weight_check_seconds', 0):.2f}"


def row(side, line):
    # The forward passes that one proof covers: a claim of zk0 evaluates two sets of weights on each of its samples.
    passes = 2 * line["samples"] if side[0] == "zk0" else 1
    setup, size = number(line, "setup_seconds", ".0f"), number(line, "proof_bytes", ".2f", 1e6)
    return [NAMES[side], str(passes), setup, prove(line), verify(line), size, memory(line), outcome(line)]


def parts(model, line):
    return [
        model,
        number(line, "argument_seconds", ".0f"),
        number(line, "argument_peak_memory_bytes", ".1f", 2**30),
        number(line, "cycles", ",.0f"),
        number(line, "prove_seconds", ".0f"),
        number(line, "peak_memory_bytes", ".1f", 2**30),
        number(line, "weight_check_seconds", ".3f"),
    ]


def beyond(models, found):
    """The models that EZKL was not tried on, because a smaller one did not fit, and the name of that one."""
    for index, model in enumerate(models):
        if found.get(("ezkl", None, model), {}).get("no_longer_fits"):
            return [larger for larger in models[index + 1 :] if ("ezkl", None, larger) not in found], model
    return [], None


def printed(cells):
    print("| " + " | ".join(cells) + " |")


def main():
    lines = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()]
    models = [size["model"] for size in json.loads((HERE / "sizes.json").read_text())]
    # The last line of a model and a side counts.
    found = {(line["side"], line.get("mode"), line["model"]): line for line in lines}
    weights = {line["model"]: line["weights"] for line in lines if "weights" in line}
    untried, limit = beyond(models, found)
    print(HEAD)
    printed(["---"] * 9)
    for model in models:
        name = f"{model}, {weights[model]:,}" if model in weights else model
        for side in SIDES:
            if line := found.get((*side, model)):
                printed([name, *row(side, line)])
        if model in untried and model in weights:
            printed([name, "EZKL", "1", *["–"] * 5, f"no longer fits: not tried, because {limit} did not fit"])
    succinct = [(model, line) for model in models if (line := found.get(("zk0", "succinct", model)))]
    if succinct:
        print(f"\n{PARTS}")
        printed(["---"] * 7)
        for model, line in succinct:
            if "cycles" in line:
                printed(parts(model, line))


if __name__ == "__main__":
    main()
