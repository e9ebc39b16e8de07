"""Find posture and parts of a new scan of a known object: python label_new_scan.py OUT SCAN.ply LABELS.npy"""

import sys

import numpy as np

import rearticulate

if __name__ == "__main__":
    out, scan, labels = sys.argv[1:]
    result, recorded = rearticulate.load_result(out), rearticulate.load_sequence_of(out)
    found = rearticulate.track(result, recorded, rearticulate.load_scans(scan))
    np.save(labels, found.labels[0])
    for name, value in zip(result.model.names[1:], found.motion.q[0, 1:], strict=True):
        print(f"{name}: {value:+.3f}")
    print(f"points lie {1000 * found.residual[0]:.2f} mm from the model, labels in {labels}")
