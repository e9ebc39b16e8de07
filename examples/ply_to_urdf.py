"""A folder of scans, one file a frame, becomes a robot description: python ply_to_urdf.py SCANS OUT"""

import sys

import rearticulate

if __name__ == "__main__":
    scans, out = sys.argv[1:]
    sequence = rearticulate.load_sequence(scans)
    result = rearticulate.fit(sequence)
    rearticulate.save_result(out, result, sequence)
    rearticulate.save_robot(f"{out}/export", result, sequence)
    print(f"{result.model.n_parts} parts, {out}/export/robot.urdf")
