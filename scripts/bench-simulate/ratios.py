"""Prints a JSON line for each figure, from the lines of measured.py in a file: ratios.py FILE"""

import json
import sys
from pathlib import Path

runs = {}
for line in Path(sys.argv[1]).read_text().splitlines():
    run = json.loads(line)
    name, side = run["run"].rsplit(" ", 1)
    runs.setdefault(name, {})[side] = run
for name, sides in runs.items():
    for figure, unit in (("seconds", "s"), ("bytes", "B")):
        ours, peer = sides["ours"][figure], sides["flower"][figure]
        of = {"seconds": "wall time", "bytes": "peak memory of all processes"}[figure]
        print(json.dumps({"bench": f"{name}: {of}", "ours": ours, "peer": peer, "ratio": peer / ours, "unit": unit}))
