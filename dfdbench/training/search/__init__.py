"""Architectures searched by a particle swarm (6.1, App. C)."""
