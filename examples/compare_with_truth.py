"""Score a fit against ground truth: python compare_with_truth.py OUT SEQUENCE.truth.npz"""

import sys

import rearticulate

if __name__ == "__main__":
    out, truth = sys.argv[1:]
    result, sequence = rearticulate.load_result(out), rearticulate.load_sequence_of(out)
    for metric in rearticulate.evaluate(result, rearticulate.load_truth(truth), sequence):
        print(f"{metric.key}: {metric.value:.3f} {metric.unit} ({metric.better} is better)")
