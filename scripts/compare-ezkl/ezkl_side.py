"""EZKL's side of the comparison: proves the evaluation of every model in sizes.json, one JSON line each, until one no
longer fits into the memory or the time given.

Needs Python alone; PyTorch and EZKL run in processes of the environment given by --python, one per step, so that
memory is measured by step and limited.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from datetime import datetime, timezone
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Once per architecture; once per update and sample; by everybody who checks.
BEFORE_SRS = ["settings", "calibrate", "compile_circuit"]
SETUP = [*BEFORE_SRS, "setup"]
PROVE = ["witness", "prove"]
VERIFY = ["verify"]
POLL_SECONDS = 0.02
# zk0_circuits::spec::Dims.
DIMS = (
    "expert_width expert_mlp heads kv_heads head_dim layers self_attn_every chunk max_action_dim action_dim max_prefix"
).split()


class StepFailed(Exception):
    """A step ended without its result; `limit` says whether for want of memory or time."""

    def __init__(self, step, reason, limit=False):
        super().__init__(f"{step}: {reason}")
        self.limit = limit


def resident_bytes(pid):
    """Memory that a process holds now."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0  # it has just ended
    return sum(int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("VmRSS:"))


def first_victim():
    """If memory runs out all the same, the kernel shall take this process and no other."""
    Path("/proc/self/oom_score_adj").write_text("1000")


def run(step, command, args):
    """Runs a step under the limits; what it printed, and what it took by the process's clock."""
    started = time.monotonic()
    with open(args.work / f"{step}.log", "w+") as log, open(args.work / f"{step}.out", "w+") as out:
        process = subprocess.Popen(
            [str(part) for part in command], stdout=out, stderr=log, preexec_fn=first_victim, cwd=args.work
        )
        ended = threading.Event()
        excess = []

        def watch():
            while not ended.wait(POLL_SECONDS):
                if resident_bytes(process.pid) > args.memory_limit * 2**30:
                    excess.append(f"needs more than {args.memory_limit:g} GiB")
                elif time.monotonic() - started > args.time_limit:
                    excess.append(f"takes longer than {args.time_limit:g} s")
                else:
                    continue
                return process.kill()

        watcher = threading.Thread(target=watch)
        watcher.start()
        try:
            # This child's own usage; getrusage(RUSAGE_CHILDREN) knows the largest of all children only.
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:  # interrupted: nothing may go on in the background
            process.kill()
            raise
        finally:
            ended.set()
            watcher.join()
        process.returncode = os.waitstatus_to_exitcode(status)
        log.seek(0)
        out.seek(0)
        printed, messages = out.read(), log.read().strip().splitlines()
    if excess:
        raise StepFailed(step, excess[0], limit=True)
    if process.returncode == -9:
        raise StepFailed(step, "killed by the kernel for want of memory", limit=True)
    if process.returncode != 0:
        last = messages[-1] if messages else "no message"
        raise StepFailed(step, f"exit code {process.returncode}: {last}")
    # CPU time tells afterwards whether a slow step had the machine for itself.
    cpu = round(usage.ru_utime + usage.ru_stime, 2)
    return printed, {"cpu_seconds": cpu, "peak_memory_bytes": usage.ru_maxrss * 1024}


def measure(model, dims, args):
    """One model through all steps: the JSON line."""
    line = {"side": "ezkl", "model": model, "dims": dims}
    line.update(inputs=args.inputs, weights_are=args.weights, memory_limit_gib=args.memory_limit)
    line.update(cpus=os.cpu_count(), load_before=os.getloadavg()[0])
    line["at"] = datetime.now(timezone.utc).isoformat(timespec="seconds")
    steps = line["steps"] = {}
    try:
        shutil.rmtree(args.work, ignore_errors=True)
        args.work.mkdir(parents=True)
        printed, _ = run("export", [args.python, "-W", "ignore", HERE / "expert.py", json.dumps(dims), args.work], args)
        expected = json.loads(printed)
        line["weights"] = expected["weights"]
        for step in [*BEFORE_SRS, "srs", "setup", *PROVE, *VERIFY]:
            command = [args.python, HERE / "ezkl_step.py", step, args.work]
            command += ["--inputs", args.inputs, "--weights", args.weights]
            if step not in BEFORE_SRS:
                settings = json.loads((args.work / "settings.json").read_text())
                srs = args.cache / f"kzg{settings['run_args']['logrows']}.srs"
                if step == "srs" and srs.exists():
                    continue
                command += ["--srs", srs]
            print(f"{model}: {step}", file=sys.stderr, flush=True)
            printed, usage = run(step, command, args)
            steps[step] = {"seconds": round(float(printed.split()[-1]), 3), **usage}
            if step == "calibrate":
                line.update(circuit(args))
        line.update(result(expected, args))
        for name, part in (("setup", SETUP), ("prove", PROVE), ("verify", VERIFY)):
            line[f"{name}_seconds"] = round(sum(steps[step]["seconds"] for step in part), 3)
        measured = [steps[step]["peak_memory_bytes"] for step in SETUP + PROVE + VERIFY]
        line["peak_memory_bytes"] = max(measured)
    except StepFailed as failure:
        line.update(failed=str(failure), no_longer_fits=failure.limit)
    return line


def circuit(args):
    """Size and scales that calibration chose."""
    settings = json.loads((args.work / "settings.json").read_text())
    chosen = {key: settings["run_args"][key] for key in ("logrows", "input_scale", "param_scale", "lookup_range")}
    # Values behind each commitment: the inputs one by one, then all weights and constants.
    committed = settings["module_sizes"]["polycommit"]
    return {"ezkl_version": settings["version"], "rows": settings["num_rows"], "committed": committed, **chosen}


def result(expected, args):
    """What was proven, against float32."""
    proof = json.loads((args.work / "proof.json").read_text())
    loss = float(proof["pretty_public_inputs"]["rescaled_outputs"][0][0])
    return {
        "squared_error": loss,
        "squared_error_float32": expected["float32"],
        "relative_error": abs(loss / expected["float32"] - 1),
        "proof_bytes": len(proof["proof"]),
        "proving_key_bytes": (args.work / "pk.key").stat().st_size,
        "verifying_key_bytes": (args.work / "vk.key").stat().st_size,
    }


def read_sizes(path, models):
    """The models asked for, all if none is; every one with exactly the fields of Dims."""
    sizes = json.loads(path.read_text())
    for size in sizes:
        if set(size["dims"]) != set(DIMS):
            raise SystemExit(f"{path}: the dims of {size['model']} must be {', '.join(DIMS)}")
    unknown = set(models or []) - {size["model"] for size in sizes}
    if unknown:
        raise SystemExit(f"{path} has no model {', '.join(sorted(unknown))}")
    return [size for size in sizes if not models or size["model"] in models]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=Path, default=Path(sys.executable), help="an interpreter that has the requirements")
    parser.add_argument("--output", type=Path, required=True, help="file of JSON lines; models in it are not run again")
    parser.add_argument("--cache", type=Path, required=True, help="folder for reference strings and the files of a run")
    parser.add_argument("--sizes", type=Path, default=HERE / "sizes.json")
    parser.add_argument("--models", nargs="*", help="only these (default: all)")
    parser.add_argument("--memory-limit", type=float, default=14, metavar="GIB")
    parser.add_argument("--time-limit", type=float, default=3600, metavar="SECONDS", help="of one step")
    parser.add_argument("--inputs", default="polycommit", help="EZKL's input_visibility")
    parser.add_argument("--weights", default="polycommit", help="EZKL's param_visibility")
    args = parser.parse_args()
    # Stopped from outside: `run` still ends its step.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    args.work = args.cache / "run"
    sizes = read_sizes(args.sizes, args.models)
    args.cache.mkdir(parents=True, exist_ok=True)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if args.output.exists():
        lines = map(json.loads, args.output.read_text().splitlines())
        done = {line["model"]: line for line in lines if line["side"] == "ezkl"}
    for size in sizes:
        model = size["model"]
        if model not in done:
            done[model] = measure(model, size["dims"], args)
            with open(args.output, "a") as output:
                output.write(json.dumps(done[model]) + "\n")
        print(json.dumps(done[model]), flush=True)
        if done[model].get("no_longer_fits"):
            break
    shutil.rmtree(args.work, ignore_errors=True)


if __name__ == "__main__":
    main()
