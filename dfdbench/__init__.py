"""Dataset builder and benchmark suite for depth from defocus."""
