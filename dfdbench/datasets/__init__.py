"""What a data set consists of, and the set as built."""
