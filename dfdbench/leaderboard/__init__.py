"""Sealed results: collected, ranked, reproduced, told."""
