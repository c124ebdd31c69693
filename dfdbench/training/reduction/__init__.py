"""Count how many filters of a trained network give distinct outputs (6.2, App. D)."""
