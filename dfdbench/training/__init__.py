"""Train the networks as the thesis did, or as is done today; needs the extra ``nets``."""
