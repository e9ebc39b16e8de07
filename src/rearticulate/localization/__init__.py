"""A finished model in new scans: its posture in each, without given correspondences."""
