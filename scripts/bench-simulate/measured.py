"""Runs a command, and prints its wall time and the peak memory of its whole process tree as a JSON line. The memory is the sum of the processes'
proportional set sizes (PSS), so that shared pages count once. It is no less than the most that one process has had resident.

    measured.py NAME COMMAND…
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path


def children(pid):
    """A process and all below it."""
    found = [pid]
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += children(int(child))
    except OSError:
        pass  # It has ended.
    return found


def memory(pid):
    """The proportional set size of a process, in bytes."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        return sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:"))
    except OSError:
        return 0


name, command = sys.argv[1], sys.argv[2:]
began, peak = time.monotonic(), 0
child = subprocess.Popen(command, stdout=sys.stderr)
while child.poll() is None:
    peak = max(peak, sum(map(memory, children(child.pid))))
    time.sleep(0.005 if time.monotonic() - began < 1 else 0.1)
seconds = time.monotonic() - began
if child.returncode != 0:
    sys.exit(f"{' '.join(command)} ended with exit code {child.returncode}")
peak = max(peak, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
print(json.dumps({"run": name, "seconds": seconds, "bytes": peak}), flush=True)
