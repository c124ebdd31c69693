"""Thin lens, measured lens table, sharpness."""
