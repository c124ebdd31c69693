"""Scenes and captures that are made."""
