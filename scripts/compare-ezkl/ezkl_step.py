"""One step of EZKL's life cycle on the files of a folder: a process of its own, so that its memory can be measured.

Prints the seconds that EZKL took, without Python's start.
"""

import argparse
import asyncio
import inspect
import json
import time
from pathlib import Path

import ezkl


def settings(folder, args):
    run_args = ezkl.PyRunArgs()
    run_args.input_visibility = args.inputs
    run_args.param_visibility = args.weights
    run_args.output_visibility = "public"
    return ezkl.gen_settings(folder / "model.onnx", folder / "settings.json", run_args)


def calibrate(folder, args):
    data = (folder / "input.json").read_text()
    return ezkl.calibrate_settings(data, folder / "model.onnx", folder / "settings.json", "resources")


def compile_circuit(folder, args):
    return ezkl.compile_circuit(folder / "model.onnx", folder / "model.compiled", folder / "settings.json")


def srs(folder, args):
    """A reference string made here: whoever makes one can forge proofs, so this is for measuring alone."""
    # Written beside and renamed, so that a killed process leaves no half of it.
    half = args.srs.with_suffix(".half")
    ezkl.gen_srs(half, json.loads((folder / "settings.json").read_text())["run_args"]["logrows"])
    half.rename(args.srs)
    return True


def setup(folder, args):
    return ezkl.setup(folder / "model.compiled", folder / "vk.key", folder / "pk.key", args.srs)


def witness(folder, args):
    data = (folder / "input.json").read_text()
    # With the key, the commitments to inputs and weights become part of the witness.
    return ezkl.gen_witness(data, folder / "model.compiled", folder / "witness.json", folder / "vk.key", args.srs)


def prove(folder, args):
    files = [folder / name for name in ("witness.json", "model.compiled", "pk.key", "proof.json")]
    return ezkl.prove(*files, args.srs)


def verify(folder, args):
    return ezkl.verify(folder / "proof.json", folder / "settings.json", folder / "vk.key", args.srs)


STEPS = {
    step.__name__: step for step in (settings, calibrate, compile_circuit, srs, setup, witness, prove, verify)
}


async def finished(step, folder, args):
    """Some versions of EZKL return an awaitable where others return the result."""
    result = step(folder, args)
    return await result if inspect.isawaitable(result) else result


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", choices=STEPS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--inputs", default="polycommit")
    parser.add_argument("--weights", default="polycommit")
    parser.add_argument("--srs", type=Path)
    args = parser.parse_args()
    started = time.monotonic()
    if not asyncio.run(finished(STEPS[args.step], args.folder, args)):
        raise SystemExit(f"{args.step} returned false")
    print(f"\n{time.monotonic() - started}")


if __name__ == "__main__":
    main()
