"""Search architectures with a particle swarm (6.1, App. C)."""
