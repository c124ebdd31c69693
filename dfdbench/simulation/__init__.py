"""Simulate scenes and captures."""
