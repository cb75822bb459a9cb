"""Fails unless both sides of a softmax regression ended with the same weights to 1e-6: equal.py FOLDER"""

import sys

import numpy as np

ours, flower = (np.fromfile(f"{sys.argv[1]}/{side}.f64") for side in ("ours", "flower"))
apart = np.abs(ours - flower).max()
print(f"largest difference of final weights: {apart:.1e}, of weights up to {np.abs(ours).max():.2f}", file=sys.stderr)
if not (len(ours) == len(flower) and apart <= 1e-6):
    sys.exit("the weights differ by more than 1e-6")
