"""How many filters of a trained network give outputs of their own (6.2, App. D)."""
