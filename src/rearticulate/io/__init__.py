"""Files in and out: point sequences, ground truth, results, resumable stages. Nothing here fits or evaluates."""

from rearticulate.io.check import check_sequence
from rearticulate.io.model import check_output, load_model, load_result, load_sequence_of, save_result
from rearticulate.io.sequence import load_scans, load_sequence, save_sequence
from rearticulate.io.stages import StageStore
from rearticulate.io.truth import load_truth, save_truth

__all__ = [
    "StageStore",
    "check_output",
    "check_sequence",
    "load_model",
    "load_result",
    "load_scans",
    "load_sequence",
    "load_sequence_of",
    "load_truth",
    "save_result",
    "save_sequence",
    "save_truth",
]
