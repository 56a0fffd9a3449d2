"""Metrics as the PhysTwin benchmark defines them, and scores against known truth."""

from physreal_core.evaluation.distances import cd_l1_oneway, cd_l2_twoway, track_errors
from physreal_core.evaluation.images import iou, on_black, psnr, ssim
from physreal_core.evaluation.measured import lift_object, seen_points
from physreal_core.evaluation.scores import FrameScores, IntervalScores, split_scores
from physreal_core.evaluation.truth import equivalent_modulus, mean_sag, vertex_errors, windowed_mean

__all__ = [
    "FrameScores",
    "IntervalScores",
    "cd_l1_oneway",
    "cd_l2_twoway",
    "equivalent_modulus",
    "iou",
    "lift_object",
    "mean_sag",
    "on_black",
    "psnr",
    "seen_points",
    "split_scores",
    "ssim",
    "track_errors",
    "vertex_errors",
    "windowed_mean",
]
