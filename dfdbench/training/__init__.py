"""Train the networks as in the thesis, or as is done today; needs the extra ``nets``."""
