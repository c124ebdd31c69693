"""Sealed results: collected, ranked, verified, told."""
